"""Numbers as text from which reading makes the same bits."""

from typing import Any

import numpy as np
from numpy.typing import NDArray


def number_texts(column: NDArray[Any], missing: str, finite: bool = False) -> list[str]:
    """Each of (n,) numbers as Python writes it; `missing` for NaN, with `finite` for inf too."""
    if column.dtype.kind == "b":
        column = column.astype(np.uint8)
    if finite and column.dtype.kind == "f":
        column = np.where(np.isfinite(column), column, np.nan)
    return [repr(value) if value == value else missing for value in column.tolist()]
