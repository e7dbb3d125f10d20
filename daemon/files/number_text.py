"""Convert numbers to text that reads back to the same bits, and find a number that was cut because
a logger was killed or a disk full."""

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

LEAST_OTHERS, MOST_OTHERS = 20, 2000
AS_SHORT = 0.02
"""Largest share of the other numbers of a column with as few digits as a number that was cut:
programs that write no zeros at the end write one of a hundred numbers two digits shorter."""


def number_texts(column: NDArray[Any], missing: str, finite: bool = False) -> list[str]:
    """Return each of (n,) numbers as Python prints it; `missing` for NaN, and with `finite` also
    for inf."""
    if column.dtype.kind == "b":
        column = column.astype(np.uint8)
    if finite and column.dtype.kind == "f":
        column = np.where(np.isfinite(column), column, np.nan)
    return [repr(value) if value == value else missing for value in column.tolist()]


def ends_inside_number(last: str, others: Sequence[str], decimal: str) -> bool:
    """Return whether the last field of a file without an end of its last line has fewer digits than
    nearly all others of its column: after the decimal mark if most have one."""
    marked = 2 * sum(decimal in other for other in others) > len(others)

    def size(field: str) -> int:
        text = field.strip().lstrip("+-")
        return len(text.partition(decimal)[2]) if marked else len(text)

    as_short = sum(size(other) <= size(last) for other in others)
    is_number = any(map(str.isdigit, last))
    return is_number and len(others) >= LEAST_OTHERS and as_short <= AS_SHORT * len(others)
