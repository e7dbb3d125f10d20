"""The guarantees of the step for any sequence of commands, faults and reloads; and its state
machine.

The reference for reached displacements is a plain numpy loop over the play operators.
"""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from tests.rigs.stepper import (
    GAIN,
    MAX_V,
    MIN_V,
    PERIOD_NS,
    SLEW,
    Bench,
    compensator,
    model,
    points,
)

from dehyst.daemon.rings.records import COMMAND, Flag, LoopCommand, State


def brute_force(drives: list[float]) -> np.ndarray:
    h, out, of = np.zeros(8), [], model().hysteresis
    for u in drives:
        for i, r in enumerate(of.r):
            h[i] = max(u - r, min(u + r, h[i]))
        out.append(float(np.dot(of.b, h)))
    return np.array(out)


actions = st.lists(
    st.one_of(
        st.tuples(st.just("set"), st.floats(-20, 20) | st.sampled_from([np.nan, np.inf, -np.inf])),
        st.tuples(st.just("play"), st.lists(st.floats(-3, 15), min_size=1, max_size=30)),
        st.tuples(st.sampled_from(["stop", "release", "fault", "back", "reload"]), st.just(0)),
        st.tuples(st.just("wait"), st.integers(1, 400)),
    ),
    max_size=12,
)


@settings(max_examples=80)
@given(actions, st.booleans())
def test_volts_stay_in_range_and_slew_whatever_happens(todo: list, end: bool) -> None:
    bench = Bench()
    bench.tick()
    for number, (what, value) in enumerate(todo):
        if what == "set":
            bench.tick((LoopCommand.SETPOINT, value))
        elif what == "play":
            bench.send(points(number + 1, value, 0, True))
        elif what == "stop":
            bench.tick((LoopCommand.STOP_MOTION, 0.0))
        elif what == "release":
            bench.tick((LoopCommand.RELEASE, 0.0))
        elif what == "fault":
            bench.stepper.fault(bench.now, "pulled")
        elif what == "back":
            bench.stepper.recover(bench.now, bench.stepper.volts)
        elif what == "reload":
            fresh = compensator(model(1.3))
            bench.stepper.reload(fresh, fresh.init(bench.stepper.volts / GAIN), 0.0)
        else:
            bench.tick(n=value)
        bench.tick(n=5)
    if end:
        bench.stepper.stop(bench.now)
        bench.tick(n=2000)
        assert bench.stepper.stopped
        assert bench.stepper.volts == bench.settings.safe_v
    volts = np.array(bench.volts)
    assert np.isfinite(volts).all()
    assert volts.min() >= MIN_V
    assert volts.max() <= MAX_V
    assert np.abs(np.diff(volts)).max() <= SLEW * 1e-3 * (1 + 1e-12)


def test_a_set_point_is_approached_slowly_and_then_held_exactly() -> None:
    bench = Bench()
    bench.tick((LoopCommand.SETPOINT, 4.0))
    assert bench.stepper.state is State.RUNNING
    record = bench.tick(n=100)
    assert record["target"] == pytest.approx(20.0 * 0.1, abs=0.05)  # approach_um_per_s = 20
    assert record["flags"] & Flag.APPROACH
    record = bench.tick(n=201)
    assert record["target"] == 4.0
    assert not record["flags"] & Flag.APPROACH
    drives = np.array(bench.volts) / GAIN
    assert brute_force(drives.tolist())[-1] == pytest.approx(4.0, abs=1e-9)
    assert record["predicted"] == pytest.approx(4.0, abs=1e-9)


def test_stale_set_point_holds_then_ramps_to_the_safe_voltage() -> None:
    bench = Bench()
    bench.tick((LoopCommand.SETPOINT, 4.0))
    bench.tick(n=1990)
    assert bench.stepper.state is State.RUNNING
    held = bench.volts[-1]
    bench.tick(n=300)  # the age counts from the end of the approach, 0.2 s
    assert bench.stepper.state is State.HOLDING
    bench.tick(n=4000)
    assert bench.volts[-1] == held
    bench.tick(n=4000)
    assert bench.stepper.state is State.READY
    assert bench.volts[-1] == bench.settings.safe_v
    ramp = np.abs(np.diff(bench.volts[-8000:]))
    assert ramp.max() <= 40.0 * 1e-3 * (1 + 1e-9)


def test_a_trajectory_is_followed_point_by_point_and_marked_done() -> None:
    bench = Bench()
    wave = (4 - 3.5 * np.cos(np.arange(1500) * 0.01)).tolist()
    for start in range(0, 1500, 100):
        bench.send(points(9, wave[start : start + 100], start, start == 1400), n=20)
    bench.tick(n=400)
    seen = [bench.tick()["target"] for _ in range(400)]
    offsets = [int(np.argmin(np.abs(np.array(wave) - t))) for t in seen[:2]]
    assert abs(offsets[1] - offsets[0]) <= 1
    bench.tick(n=1000)
    assert bench.stepper.trajectory_done
    assert bench.stepper.trajectory == 9
    assert bench.stepper.record[0]["target"] == pytest.approx(wave[-1])


def test_a_client_that_dies_in_mid_trajectory_leaves_hold_then_ramp() -> None:
    bench = Bench()
    bench.send(points(3, np.linspace(0, 6, 500).tolist(), 0, False), n=600)
    assert any("run dry" in e for e in bench.stepper.events)
    assert bench.stepper.record[0]["flags"] & Flag.FALLBACK
    bench.tick(n=2100)
    assert bench.stepper.state is State.HOLDING
    bench.tick(n=8000)
    assert bench.stepper.volts == bench.settings.safe_v


def test_unreachable_targets_are_flagged_not_hidden() -> None:
    bench = Bench()
    bench.tick((LoopCommand.SETPOINT, 40.0))
    record = bench.tick(n=2100)  # the approach takes 2 s
    assert record["flags"] & Flag.UNREACHABLE
    assert record["target"] == 40.0
    assert record["volts"] == MAX_V


def test_reload_does_not_jump_and_arrives_at_the_target_of_the_new_model() -> None:
    bench = Bench()
    bench.tick((LoopCommand.SETPOINT, 4.0))
    bench.tick(n=500)
    fresh = compensator(model(1.25))
    state = fresh.init(0.0)
    for volts in bench.volts:
        fresh.applied(state, volts / GAIN)
    before = bench.stepper.volts
    bench.stepper.reload(fresh, state, 0.0)
    bench.tick((LoopCommand.SETPOINT, 4.0))
    assert abs(bench.stepper.volts - before) <= 40.0 * 1e-3 * (1 + 1e-9)
    for _ in range(6):
        bench.tick((LoopCommand.SETPOINT, 4.0), n=300)
    assert bench.stepper.record[0]["predicted"] == pytest.approx(4.0, abs=1e-6)
    assert bench.stepper.volts < before


def test_fault_stops_all_voltage_until_the_device_is_back() -> None:
    bench = Bench()
    bench.tick((LoopCommand.SETPOINT, 4.0))
    bench.tick(n=500)
    bench.stepper.fault(bench.now, "unplugged")
    held = bench.stepper.volts
    bench.tick((LoopCommand.SETPOINT, 1.0), n=50)
    assert bench.stepper.volts == held
    bench.stepper.recover(bench.now, held)
    assert bench.stepper.state is State.READY  # on_fault = "hold"
    bench.tick((LoopCommand.SETPOINT, 4.0), n=400)
    assert bench.stepper.state is State.RUNNING


@pytest.fixture
def recorded() -> list[tuple[int, float, bytes]]:
    rng = np.random.default_rng(3)
    return [
        (i * PERIOD_NS, float(rng.normal()), points(1, [0.01 * i], i, False).tobytes())
        for i in range(300)
    ]


def test_the_same_inputs_give_the_same_records(recorded: list[tuple[int, float, bytes]]) -> None:
    outputs = []
    for _ in range(2):
        stepper, out = Bench().stepper, []
        for now, measured, raw in recorded:
            record = stepper.step(now, measured, np.frombuffer(raw, COMMAND))
            stepper.follow_output(float(record["volts"][0]))
            out.append(stepper.record.tobytes())
        outputs.append(b"".join(out))
    assert outputs[0] == outputs[1]
