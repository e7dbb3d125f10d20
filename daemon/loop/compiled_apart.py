"""Compile the loop's kernels in two processes at once where they are not on disk yet.

numba compiles one kernel at a time in a process, and a kernel after all kernels that it calls. So
another process begins with the largest part, the inverse's plan, while this one compiles the
kernels that do not need it; each finds the other's results on disk. If that fails (nothing can be
stored, or the other process died), this process compiles everything itself later.
"""

import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager

from numba import types

from dehyst.daemon.loop.axes import groups, kernels
from dehyst.daemon.loop.sample import finish, take_requests
from dehyst.daemon.loop.step_kernel import stopped
from dehyst.models.inverse.compiling import compile_plan, compile_sample_kernels, is_plan_cached

WORDS, INTEGER = types.int64[::1], types.int64


def compile_in_two() -> None:
    """Compile more than half of what `warm_up` runs, unless it is on disk already."""
    if is_plan_cached():
        return
    with compiling_beside(__name__):
        _compile_around_step()
        compile_sample_kernels()


@contextmanager
def compiling_beside(module: str) -> Iterator[None]:
    """Run a module in another process during the block; wait for it, or end it on an error."""
    other = subprocess.Popen([sys.executable, "-m", module], stdin=subprocess.DEVNULL)
    try:
        yield
        other.wait()
    finally:
        other.kill()
        other.wait()


def _compile_around_step() -> None:
    """Compile what a sample does before and after its step."""
    take_requests.compile((WORDS, INTEGER))
    groups.coordinate.compile((WORDS, INTEGER))
    kernels.next_axis.compile((WORDS,))
    kernels.follow_axes.compile((WORDS, INTEGER))
    finish.compile((WORDS, *(7 * (INTEGER,))))
    stopped.compile((WORDS, INTEGER))


if __name__ == "__main__":
    compile_plan()
