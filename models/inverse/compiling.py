"""The inverse's kernels in two halves, for whoever compiles them in two processes.

The half that plans ahead takes as long as all that `propose_drive` calls beside it.
"""

from pathlib import Path

from numba import types

from dehyst.models.inverse import lookahead, preview, sample
from dehyst.models.inverse.state import INVERSE

FLOATS = types.float64[::1]


def plan_is_on_disk() -> bool:
    """Whether some process has compiled `compile_plan`'s half and kept it."""
    kept = Path(preview.propose.stats.cache_path)
    return any(kept.glob(f"{preview.__name__.rpartition('.')[2]}.propose-*.nbi"))


def compile_plan() -> None:
    """Compile the plan and what it calls."""
    preview.propose.compile((INVERSE, types.boolean))


def compile_beside_plan() -> None:
    """Compile what a sample needs beside the plan."""
    lookahead.present.compile((INVERSE,))
    lookahead.gather_targets.compile((INVERSE,))
    lookahead.take_window.compile((INVERSE, FLOATS, types.int64))
    sample.aside.compile((INVERSE, types.float64))
    sample.applied.compile((INVERSE, types.float64, types.boolean))
