"""The witness counts when it could not be on time, and excuses no loop when it was on time."""

import math
import os
import signal
import time

import pytest
from tests.benchmarks.bars import Bars
from tests.benchmarks.daemon.learning_through_serial import judge
from tests.benchmarks.late_wakeups import LATE_SHARE, LateWakeups, was_away


def test_a_witness_that_is_stopped_is_late_for_as_long() -> None:
    with LateWakeups() as witness:
        if witness.refused:
            pytest.skip("needs the privilege of FIFO scheduling (ulimit -r 98)")
        time.sleep(0.5)
        begun = time.monotonic()
        os.kill(witness.processes[-1].pid, signal.SIGSTOP)
        time.sleep(1.0)
        os.kill(witness.processes[-1].pid, signal.SIGCONT)
        stopped_s = time.monotonic() - begun
        time.sleep(0.5)
        lived_s = time.monotonic() - begun + 0.5
        assert stopped_s / lived_s - 0.1 < witness.share <= 1.0
    assert all(process.poll() is not None for process in witness.processes)


@pytest.mark.parametrize(
    ("gain", "share", "busy", "code"),
    [
        (5.1, 0.0, "", 0),
        (5.1, 0.2, "", 0),  # the passes that count met all their deadlines
        (4.9, 0.0, "", 1),
        (4.9, 2.0 * LATE_SHARE, "", 77),
        (math.nan, 2.0 * LATE_SHARE, "", 77),
        (math.nan, 0.5 * LATE_SHARE, "", 1),  # the witness was on time and the loop was not
        (math.nan, 0.0, "the load was high before", 77),  # not the loop's fault
        (math.nan, math.nan, "the load was high before", 77),
        (math.nan, math.nan, "", 1),
    ],
)
def test_only_a_machine_that_was_away_or_busy_before_excuses(
    gain: float, share: float, busy: str, code: int
) -> None:
    bars = Bars()
    judge(bars, "1 Hz", gain, share, busy)
    assert bars.code == code
    assert ("was away" in bars.table()) == (code == 77 and share > LATE_SHARE)


def test_the_reason_names_the_figure() -> None:
    assert "in 16 % of its periods" in was_away(0.16)
    assert was_away(LATE_SHARE) == was_away(math.nan) == ""
