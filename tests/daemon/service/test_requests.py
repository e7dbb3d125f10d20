"""Signals to the loop's process: before the loop runs, and requests to reload."""

import logging
import os
import signal
import subprocess
import sys
import threading
from collections.abc import Iterator
from contextlib import suppress

import pytest
from tests.rigs.gateway_bench import ROOT

from dehyst.daemon.service.requests import Requests

TAKEN = (signal.SIGTERM, signal.SIGINT, signal.SIGHUP)


@pytest.fixture
def requests() -> Iterator[Requests]:
    before = {number: signal.getsignal(number) for number in TAKEN}
    yield Requests()
    for number, handler in before.items():
        signal.signal(number, handler)


@pytest.mark.parametrize("number", [signal.SIGTERM, signal.SIGINT])
def test_asked_to_end_while_it_compiles_it_ends_with_0_and_no_traceback(
    requests: Requests, number: signal.Signals
) -> None:
    """A request to end during compilation ends with status 0 and without a traceback, although
    numba turns an exit that is raised in the middle of a compilation into an error of its own."""

    def compiled() -> None:
        try:
            os.kill(os.getpid(), number)
        except SystemExit:
            raise RuntimeError("no compiled object yet") from None

    with pytest.raises(SystemExit) as end, requests.before_the_loop():
        compiled()
    assert end.value.code == 0
    assert end.value.__suppress_context__


def test_an_exit_that_was_swallowed_is_made_up_for_before_the_loop_runs(requests: Requests) -> None:
    with suppress(SystemExit):  # as a callback from C does in the middle of a compilation
        os.kill(os.getpid(), signal.SIGTERM)
    with pytest.raises(SystemExit) as end:
        requests.serve(lambda: None, lambda: None)
    assert end.value.code == 0


def test_an_error_that_nobody_asked_for_stays_one(requests: Requests) -> None:
    with pytest.raises(RuntimeError, match="no compiled object"), requests.before_the_loop():
        raise RuntimeError("no compiled object yet")


def test_a_reload_that_fails_unexpectedly_is_logged_and_the_next_one_is_served(
    requests: Requests, caplog: pytest.LogCaptureFixture
) -> None:
    begun = threading.Semaphore(0)
    served: list[str] = []

    def reload() -> None:
        served.append("")
        begun.release()
        raise KeyError("nobody expected this")

    requests._rest_s = 0.0
    with caplog.at_level(logging.ERROR):
        requests.serve(lambda: None, reload)
        for _ in range(2):
            os.kill(os.getpid(), signal.SIGHUP)
            assert begun.acquire(timeout=20.0), f"{len(served)} requests were served"
    assert "nobody expected this" in caplog.text


LOST = """
import ctypes, os, signal
from dehyst.daemon.service.requests import Requests

requests = Requests()
with requests.before_the_loop():
    ctypes.CFUNCTYPE(None)(lambda: os.kill(os.getpid(), signal.{number}))()
    {then}
    print("served")
"""
SERVE = "requests.serve(lambda: None, lambda: None)"
COMPILE = "import time; time.sleep(50.0)  # as it does for a minute"


@pytest.mark.parametrize("then", [SERVE, COMPILE], ids=["serve", "compile"])
@pytest.mark.parametrize("number", ["SIGTERM", "SIGINT"])
def test_an_exit_that_a_callback_from_c_loses_leaves_no_traceback_and_comes_again(
    number: str, then: str
) -> None:
    done = subprocess.run(
        [sys.executable, "-c", LOST.format(number=number, then=then)],
        capture_output=True, text=True,
        env={"PYTHONPATH": str(ROOT / "src")}, timeout=40, check=False,
    )  # fmt: skip
    assert (done.returncode, done.stdout, done.stderr) == (0, "", "")
