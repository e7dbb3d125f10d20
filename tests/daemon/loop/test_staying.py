"""A lasting set-point or hold: only a command, a fault or the end of the daemon ends it.

The configuration sets what goes stale and when (2 s, then 5 s of holding, in this rig).
"""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from tests.rigs.stepper import Bench, points

from dehyst.daemon.rings.records import COMMAND, LoopCommand, State

LONG = 60_000  # samples: a minute, far beyond stale_s and hold_s


def command(kind: LoopCommand, value: float = 0.0, lasts: bool = False) -> np.ndarray:
    record = np.zeros(1, COMMAND)
    record["kind"], record["value"], record["last"] = kind, value, lasts
    return record


def at_a_place(lasts: bool) -> Bench:
    bench = Bench()
    bench.tick()
    bench.send(command(LoopCommand.SETPOINT, 4.0, lasts), n=400)
    return bench


@pytest.mark.parametrize("lasts", [True, False])
def test_a_place_is_kept_without_a_client_only_where_that_was_asked_for(lasts: bool) -> None:
    bench = at_a_place(lasts)
    volts = bench.stepper.volts
    assert bench.stepper.control["stays"][0] == lasts
    bench.tick(n=LONG)
    assert (bench.stepper.state is State.RUNNING) == lasts
    assert (bench.stepper.volts == pytest.approx(volts, abs=1e-9)) == lasts


def test_a_hold_keeps_the_voltage_in_mid_motion_and_on_the_way_down() -> None:
    bench = Bench()
    bench.tick()
    bench.send(points(7, np.linspace(2.0, 8.0, 2000).tolist(), 0, True), n=600)
    moving = bench.stepper.volts
    bench.send(command(LoopCommand.HOLD, lasts=True), n=LONG)
    assert bench.stepper.state is State.HOLDING
    assert bench.stepper.volts == pytest.approx(moving, abs=0.2)  # within a step of the motion
    assert np.isnan(bench.stepper.record[0]["target"])
    bench.send(command(LoopCommand.STOP_MOTION), n=5500)  # a stop ends it: 5 s, then down
    down = bench.stepper.volts
    assert 0.0 < down < moving
    bench.send(command(LoopCommand.HOLD), n=4900)
    assert bench.stepper.volts == pytest.approx(down, abs=0.05)
    bench.tick(n=200)
    assert bench.stepper.volts < down - 1.0  # this one did not last


ENDS = {
    "set-point": lambda b: b.send(command(LoopCommand.SETPOINT, 3.0)),
    "trajectory": lambda b: b.send(points(9, [3.0, 3.1], 0, True)),
    "stop": lambda b: b.send(command(LoopCommand.STOP_MOTION)),
    "release": lambda b: b.send(command(LoopCommand.RELEASE)),
    "hold": lambda b: b.send(command(LoopCommand.HOLD)),
    "fault": lambda b: (b.stepper.fault(b.now, "pulled"), b.stepper.recover(b.now, 20.0)),
    "end": lambda b: b.stepper.stop(b.now),
}


@pytest.mark.parametrize("kind", [LoopCommand.SETPOINT, LoopCommand.HOLD])
@pytest.mark.parametrize("end", list(ENDS))
def test_every_other_command_ends_it(end: str, kind: LoopCommand) -> None:
    bench = at_a_place(True)
    if kind is LoopCommand.HOLD:
        bench.send(command(kind, lasts=True), n=10)
    ENDS[end](bench)
    bench.tick(n=2)
    assert not bench.stepper.control["stays"][0]
    bench.tick(n=LONG)
    assert bench.stepper.state is not State.RUNNING
    if end != "fault":  # after a fault the output stays as it was found
        assert bench.stepper.volts == bench.settings.safe_v


@settings(max_examples=40)
@given(st.lists(st.sampled_from([*ENDS, "lasting", "wait"]), max_size=8))
def test_what_lasts_is_the_newest_command(todo: list[str]) -> None:
    bench = Bench()
    bench.tick()
    lasts = False
    for what in todo:
        if what == "end":
            continue
        if what == "lasting":
            bench.send(command(LoopCommand.SETPOINT, 4.0, True))
            lasts = True
        elif what != "wait":
            ENDS[what](bench)
            lasts = False
        bench.tick(n=50)
        assert bool(bench.stepper.control["stays"][0]) == lasts
