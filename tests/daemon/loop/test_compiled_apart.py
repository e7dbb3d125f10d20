"""If no kernel is on disk, the loop's kernels are compiled in two processes."""

import json
import subprocess
import sys
from typing import Any

import pytest

from dehyst.daemon.loop import compiled_apart
from dehyst.models.inverse.compiling import compile_plan

SIGNATURES = """
import json
from numba import njit, types
from dehyst.daemon.loop import compiled_apart
from dehyst.daemon.loop.axes import groups, kernels
from dehyst.daemon.loop.compiled_loop import run_samples
from dehyst.daemon.loop.sample import finish, take_requests
from dehyst.daemon.loop.step_kernel import stopped
from dehyst.models.inverse import lookahead, preview, sample
from dehyst.models.inverse.compiling import FLOATS, compile_sample_kernels, compile_plan
from dehyst.models.inverse.state import INVERSE

def compiled_anew(kernel, *signature):
    njit(nogil=True)(kernel.py_func).compile(signature)

compile_plan()
compile_sample_kernels()
compiled_apart._compile_around_step()
compiled_anew(sample.propose_drive, INVERSE, FLOATS, types.int64)
compiled_anew(sample._follow, INVERSE)
compiled_anew(sample.applied_at, types.int64, types.float64, types.boolean)
compiled_anew(kernels.begin_axes, types.int64[::1], types.int64, FLOATS)
compiled_anew(run_samples, types.int64[::1], types.int64)
halves = (
    preview.propose, lookahead.present_target, lookahead.gather_targets, lookahead.take_window,
    sample.parallel_contribution, sample.applied,
    take_requests, groups.coordinate, kernels.next_axis, kernels.follow_axes, finish, stopped,
)
print(json.dumps({kernel.__name__: len(kernel.signatures) for kernel in halves}))
"""
"""Compiles again, typed by numba itself, what calls the halves directly, and prints for how many
types each half then exists. Needs a process in which nothing else has called them."""


def test_each_half_is_what_the_loop_then_calls() -> None:
    """Each half is compiled for exactly the types with which the loop calls it; otherwise its
    caller would compile it again."""
    done = subprocess.run(
        [sys.executable, "-c", SIGNATURES], capture_output=True, text=True, check=False, timeout=240
    )
    assert done.returncode == 0, done.stderr
    found = json.loads(done.stdout)
    assert len(found) == 12
    assert found == dict.fromkeys(found, 1)


def test_no_process_is_started_where_the_plan_is_on_disk(monkeypatch: pytest.MonkeyPatch) -> None:
    compile_plan()  # from disk, if it is there

    def refuse(*_: Any, **__: Any) -> None:
        raise AssertionError("a process was started")

    monkeypatch.setattr(compiled_apart.subprocess, "Popen", refuse)
    compiled_apart.compile_in_two()


def test_a_process_that_dies_costs_time_alone(monkeypatch: pytest.MonkeyPatch) -> None:
    """If the second process dies, the first one compiles everything itself and only time is
    lost."""
    monkeypatch.setattr(compiled_apart, "is_plan_cached", lambda: False)
    start = subprocess.Popen
    monkeypatch.setattr(
        compiled_apart.subprocess, "Popen", lambda *_, **options: start(["false"], **options)
    )
    compiled_apart.compile_in_two()
