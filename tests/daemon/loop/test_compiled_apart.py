"""The loop's kernels are compiled in two processes where none is on disk."""

import subprocess
from typing import Any

import pytest
from numba import njit, types

from dehyst.daemon.loop import compiled_apart
from dehyst.daemon.loop.axes import groups, kernels
from dehyst.daemon.loop.compiled_loop import run_samples
from dehyst.daemon.loop.sample import finish, take_requests
from dehyst.daemon.loop.step_kernel import stopped
from dehyst.models.inverse import lookahead, preview, sample
from dehyst.models.inverse.compiling import FLOATS, compile_beside_plan, compile_plan
from dehyst.models.inverse.state import INVERSE

OF_THE_INVERSE = (
    preview.propose, lookahead.present, lookahead.gather_targets, lookahead.take_window,
    sample.aside, sample.applied,
)  # fmt: skip
OF_THE_LOOP = (
    take_requests, groups.coordinate, kernels.next_axis, kernels.follow_axes, finish, stopped,
)  # fmt: skip


def compiled_anew(kernel: Any, *signature: Any) -> None:
    """What calls the halves, typed and compiled again by numba itself."""
    njit(nogil=True)(kernel.py_func).compile(signature)


def test_each_half_is_what_the_loop_then_calls() -> None:
    """A half that was compiled for other types would be compiled again by whoever calls it."""
    compile_plan()
    compile_beside_plan()
    compiled_apart._compile_around_step()
    compiled_anew(sample.propose_drive, INVERSE, FLOATS, types.int64)
    compiled_anew(kernels.begin_axes, types.int64[::1], types.int64, FLOATS)
    compiled_anew(run_samples, types.int64[::1], types.int64)
    for kernel in (*OF_THE_INVERSE, *OF_THE_LOOP):
        assert len(kernel.signatures) == 1, kernel.__name__


def test_no_process_is_started_where_the_plan_is_on_disk(monkeypatch: pytest.MonkeyPatch) -> None:
    compile_plan()

    def refuse(*_: Any, **__: Any) -> None:
        raise AssertionError("a process was started")

    monkeypatch.setattr(compiled_apart.subprocess, "Popen", refuse)
    compiled_apart.compile_in_two()


def test_a_process_that_dies_costs_time_alone(monkeypatch: pytest.MonkeyPatch) -> None:
    """This one goes on by itself."""
    monkeypatch.setattr(compiled_apart, "plan_is_on_disk", lambda: False)
    start = subprocess.Popen
    monkeypatch.setattr(
        compiled_apart.subprocess, "Popen", lambda *_, **options: start(["false"], **options)
    )
    compiled_apart.compile_in_two()
