"""Convert numbers to text that reads back to the same bits."""

from typing import Any

import numpy as np
from numpy.typing import NDArray


def number_texts(column: NDArray[Any], missing: str, finite: bool = False) -> list[str]:
    """Return each of (n,) numbers as Python prints it; `missing` for NaN, and with `finite` also
    for inf."""
    if column.dtype.kind == "b":
        column = column.astype(np.uint8)
    if finite and column.dtype.kind == "f":
        column = np.where(np.isfinite(column), column, np.nan)
    return [repr(value) if value == value else missing for value in column.tolist()]
