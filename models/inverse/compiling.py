"""Compile the inverse's kernels in two halves, so that two processes can share the work.

The half that plans ahead takes as long as everything else that `propose_drive` calls.
"""

from pathlib import Path

from numba import types

from dehyst.models.inverse import lookahead, preview, sample
from dehyst.models.inverse.state import INVERSE

FLOATS = types.float64[::1]


def is_plan_cached() -> bool:
    """Return whether the half of `compile_plan` is in the compilation cache on disk."""
    kept = Path(preview.propose.stats.cache_path)
    return any(kept.glob(f"{preview.__name__.rpartition('.')[2]}.propose-*.nbi"))


def compile_plan() -> None:
    """Compile the plan and what it calls."""
    preview.propose.compile((INVERSE, types.boolean))


def compile_sample_kernels() -> None:
    """Compile what a sample needs in addition to the plan."""
    lookahead.present_target.compile((INVERSE,))
    lookahead.gather_targets.compile((INVERSE,))
    lookahead.take_window.compile((INVERSE, FLOATS, types.int64))
    sample.parallel_contribution.compile((INVERSE, types.float64))
    sample.applied.compile((INVERSE, types.float64, types.boolean))
