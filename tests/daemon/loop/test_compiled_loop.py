"""The compiled engine against the Python loop: the same inputs give the same records."""

import itertools
import math
import time
import tracemalloc

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from tests.rigs.two_loops import LOOK_NS, PERIOD_NS, Rig

from dehyst.daemon.loop.status import PLACE
from dehyst.daemon.rings.records import COMMAND, Flag, LoopCommand, State

names = (f"engine-{i}" for i in itertools.count())


def command(kind: LoopCommand, value: float = 0.0, count: int = 1, first: int = 0) -> np.ndarray:
    batch = np.zeros(count, COMMAND)
    batch["kind"], batch["trajectory"] = kind, 7
    batch["offset_ns"] = (first + np.arange(count)) * PERIOD_NS
    batch["value"] = value + 0.1 * np.arange(count)
    return batch


batches = st.lists(
    st.one_of(
        st.builds(
            command, st.just(LoopCommand.SETPOINT), st.floats(-5, 30) | st.just(float("nan")),
        ),
        st.builds(
            command, st.just(LoopCommand.POINT), st.floats(0, 12), st.integers(1, 60),
            st.integers(0, 200),
        ),
        st.builds(
            command,
            st.sampled_from([LoopCommand.STOP_MOTION, LoopCommand.RELEASE, LoopCommand.CLEAR]),
        ),
        st.just(np.zeros(0, COMMAND)),
    ),
    min_size=1,
    max_size=6,
)  # fmt: skip
lateness = st.lists(st.integers(0, 3_500_000), min_size=1, max_size=7)


@pytest.mark.parametrize("mode", ["static", "causal", "preview"])
@settings(max_examples=15)
@given(batches, lateness)
def test_both_engines_give_the_same_records(
    mode: str, todo: list[np.ndarray], late: list[int]
) -> None:
    rigs = [Rig(next(names), mode, late) for _ in range(2)]
    python, compiled = (rig.play(todo, 60, compiled=bool(i)) for i, rig in enumerate(rigs))
    for record in (python, compiled):
        record["cause"] = 0  # why this machine was late is not part of the step
    assert python.tobytes() == compiled.tobytes()
    assert rigs[0].monitor.missed == rigs[1].monitor.missed
    for name in ("wake", "exec", "io"):
        pair = [getattr(rig.monitor, name).bins for rig in rigs]
        np.testing.assert_array_equal(*pair)
    events = [[r["text"] for r in rig.rings["event"].read(0)[0]] for rig in rigs]
    assert events[0] == events[1]


@pytest.mark.parametrize("compiled", [False, True])
def test_late_wake_ups_do_not_add_up(compiled: bool) -> None:
    rig = Rig(next(names), lateness_ns=[250_000, 0, 900_000, 400])
    records = rig.play([np.zeros(0, COMMAND)], 3000, compiled)
    start = records["scheduled_ns"][0]
    np.testing.assert_array_equal(
        records["scheduled_ns"], start + PERIOD_NS * np.arange(records.size)
    )
    late = records["actual_ns"] - records["scheduled_ns"]
    assert late.max() == 900_000
    assert rig.monitor.missed == 0


@pytest.mark.parametrize("compiled", [False, True])
def test_missed_deadlines_are_flagged_counted_and_never_made_up(compiled: bool) -> None:
    rig = Rig(next(names), lateness_ns=[0] * 9 + [3_400_000])
    records = rig.play([command(LoopCommand.SETPOINT, 4.0)], 400, compiled)
    flagged = records["flags"] & Flag.MISSED > 0
    passed = (rig.scheduled_ns - records["scheduled_ns"][0]) // PERIOD_NS
    assert rig.monitor.missed == 3 * flagged.sum()
    assert passed == (~flagged).sum() + rig.monitor.missed
    assert (np.diff(records["scheduled_ns"]) >= PERIOD_NS).all()
    assert rig.monitor.missed_by.sum() == rig.monitor.missed


@pytest.mark.parametrize("compiled", [False, True])
def test_an_unplugged_stage_is_a_fault_and_comes_back(compiled: bool) -> None:
    rig = Rig(next(names))
    rig.play([command(LoopCommand.SETPOINT, 4.0)], 30, compiled)
    held = rig.stepper.volts
    rig.stage.plugged = False
    records = rig.play([command(LoopCommand.SETPOINT, 5.0)], 60, compiled)[30:]
    assert records["flags"][0] & (Flag.WRITE_FAILED | Flag.SENSOR_INVALID)
    assert State(records["state"][-1]) is State.FAULT
    assert (records["volts"][1:] == records["volts"][1]).all()
    assert abs(records["volts"][-1] - held) < 1e-9
    assert np.isnan(records["measured"]).all()
    rig.stage.plugged = True
    for _ in range(200):  # the thread that reconnects runs in real time
        rig.play([np.zeros(0, COMMAND)], 20, compiled)
        if rig.monitor.numbers[PLACE["actuator_ok"]] and rig.stepper.state is not State.FAULT:
            break
        time.sleep(0.01)
    assert rig.stepper.state in (State.HOLDING, State.READY)  # on_fault = "ramp"
    records = rig.play([np.zeros(0, COMMAND)], 900, compiled)
    assert records["volts"][-1] == 5.0


@pytest.mark.parametrize("compiled", [False, True])
def test_asked_to_stop_it_ends_in_the_configured_state(compiled: bool) -> None:
    rig = Rig(next(names))
    rig.play([command(LoopCommand.SETPOINT, 9.0)], 90, compiled)
    assert rig.stepper.volts > 60.0
    rig.monitor.stop()
    records = rig.play([np.zeros(0, COMMAND)], 100_000, compiled)
    assert records["volts"][-1] == 5.0
    assert State(records["state"][-1]) is State.STOPPING
    ramp = np.diff(records["volts"][records["state"] == State.STOPPING])
    assert np.abs(ramp).max() <= 0.4 * (1 + 1e-9)


def test_a_look_at_the_clock_costs_time_in_both(  # the virtual clocks agree
) -> None:
    rig = Rig(next(names), lateness_ns=[0])
    records = rig.play([command(LoopCommand.SETPOINT, 4.0)], 20, True)
    assert records["io_us"][1] == pytest.approx(2 * LOOK_NS * 1e-3)


@pytest.mark.parametrize("compiled", [False, True])
def test_memory_does_not_grow_from_sample_to_sample(compiled: bool) -> None:
    """On average a sample leaves less than one byte allocated. Objects that replace older ones
    count too, for a while; so the window that grew least is taken, and each window is so long that
    such objects are little compared with one byte per sample."""
    samples = 4000
    rig = Rig(next(names))
    rig.play([command(LoopCommand.SETPOINT, 4.0)], 600, compiled)
    grown = []
    tracemalloc.start()
    try:
        while len(grown) < 10 and min(grown, default=math.inf) >= samples:
            before = tracemalloc.get_traced_memory()[0]
            rig.play([command(LoopCommand.POINT, 3.0, 50)] * 4, samples, compiled)
            grown.append(tracemalloc.get_traced_memory()[0] - before)
    finally:
        tracemalloc.stop()
    assert min(grown) < samples  # one byte per sample would end a run of a month
