"""How the stage moves after an interruption: from where it is, by a glide, and no further than its
position is known.

The limits are written out: the ramp is 0.04 V per sample, an approach 0.02 um per sample, the range
0 to 75 V.
"""

import numpy as np
import pytest
from tests.rigs.stepper import CONFIG, GAIN, PERIOD_NS, Bench, compensator, model, points

from dehyst.daemon.rings.records import COMMAND, Flag, LoopCommand, State

RAMP_V, SLEW_V, APPROACH_UM = 0.04, 2.0, 0.02


def steps(bench: Bench, first: int) -> np.ndarray:
    """Return the sizes of the output's steps from this sample on [V]."""
    return np.abs(np.diff(np.array(bench.volts[first - 1 :])))


@pytest.mark.parametrize("volts", [0.0, 30.0, 75.0])
@pytest.mark.parametrize("kind", ["set-point", "trajectory"])
def test_an_approach_begins_where_the_stage_stands(volts: float, kind: str) -> None:
    """An approach starts at the stage's present position, so that the output does not jump. The
    output is at `volts` when the first command comes; a drive of 0 to 10 makes about as many
    micrometres."""
    bench = Bench(volts)
    stands = bench.stepper.record[0]["predicted"]
    bench.tick(n=10)
    stands = float(bench.stepper.record[0]["predicted"])
    first = len(bench.volts)
    if kind == "set-point":
        record = bench.tick((LoopCommand.SETPOINT, 5.0), n=2)
    else:
        record = bench.send(points(4, [5.0] * 50, 0, False), n=2)
    assert abs(record["target"] - stands) <= 2 * APPROACH_UM + 1e-9
    assert record["flags"] & Flag.APPROACH
    bench.tick(n=20)
    # one sample of an approach moves the output by less than 0.3 V, wherever the loop is entered
    assert steps(bench, first).max() < 0.3


def test_an_approach_in_motion_begins_at_the_present_target() -> None:
    bench = Bench()
    bench.send(points(4, np.linspace(0.0, 4.0, 400).tolist(), 0, False), n=300)
    now = float(bench.stepper.record[0]["target"])
    record = bench.tick((LoopCommand.SETPOINT, 0.5), n=2)
    assert abs(record["target"] - now) <= 2 * APPROACH_UM + 1e-9


def wave(count: int) -> list[float]:
    """Return a sine of 2 Hz with an amplitude of 3 um."""
    return (4.0 - 3.0 * np.cos(2 * np.pi * 2.0 * np.arange(count) * 1e-3)).tolist()


def test_after_a_stand_still_it_glides_to_where_the_target_has_gone() -> None:
    """After a pause of 0.2 s, in which the wave moves on by more than 2 um, the stage glides to the
    target instead of jumping."""
    bench = Bench()
    bench.send(points(4, wave(3000), 0, True), n=700)
    before = len(bench.volts)
    bench.now += 200 * PERIOD_NS
    bench.tick()
    assert any("the loop paused" in event for event in bench.stepper.events)
    bench.tick(n=1500)
    # the wave needs 0.038 um, or 0.355 V where the stage is least sensitive; a glide a third more
    assert steps(bench, before).max() <= 0.46
    assert steps(bench, before)[:10].max() <= RAMP_V  # it starts gently
    error = bench.stepper.record[0]["predicted"] - bench.stepper.record[0]["target"]
    assert abs(error) < 0.05


def test_samples_of_a_glide_are_flagged_so_that_nobody_judges_a_model_by_them() -> None:
    """Samples are flagged while the stage is further from the target than its ordinary error, so
    that no model is judged by them."""
    bench = Bench()
    bench.send(points(4, wave(3000), 0, True), n=700)
    assert not bench.stepper.record[0]["flags"] & Flag.APPROACH
    bench.now += 200 * PERIOD_NS
    off, flagged = [], []
    for _ in range(1500):
        bench.tick()
        record = bench.stepper.record[0]
        off.append(abs(float(record["predicted"] - record["target"])))
        flagged.append(bool(record["flags"] & Flag.APPROACH))
    assert max(off) > 0.9
    assert all(on_way for away, on_way in zip(off[1:], flagged[1:], strict=True) if away > 0.1)
    assert not flagged[-1]
    assert flagged == sorted(flagged, reverse=True)  # one stretch, which ends


def test_a_stand_still_of_half_a_tenth_of_a_second_is_no_reason_to_glide() -> None:
    bench = Bench()
    bench.send(points(4, wave(3000), 0, True), n=700)
    bench.now += 50 * PERIOD_NS
    bench.tick()
    assert not any("the loop paused" in event for event in bench.stepper.events)


def test_a_starved_stream_that_returns_is_reached_by_a_glide() -> None:
    """When points come for 0.5 s, not for 0.2 s, and then all at once, 2 um further on, the stage
    glides to them within the ramp rate."""
    bench = Bench()
    way = np.concatenate([np.linspace(0.0, 2.0, 500), np.full(200, 2.0), np.full(900, 4.0)])
    bench.send(points(4, way[:500].tolist(), 0, False), n=700)
    assert bench.stepper.record[0]["flags"] & Flag.FALLBACK
    before = len(bench.volts)
    bench.send(points(4, way[700:].tolist(), 700, True), n=20)
    assert steps(bench, before).max() <= RAMP_V + 1e-9  # 15 V are left to go
    bench.tick(n=480)
    assert steps(bench, before).max() <= 2.0 * RAMP_V
    assert steps(bench, before).max() >= 0.4 * RAMP_V
    bench.tick(n=800)
    assert bench.stepper.record[0]["predicted"] == pytest.approx(4.0, abs=0.05)


def test_a_starved_stream_is_given_its_two_seconds_from_when_it_ran_dry() -> None:
    bench = Bench()
    bench.send(points(4, np.linspace(0.0, 4.0, 2500).tolist(), 0, False), n=2500)
    bench.tick(n=1900)
    assert bench.stepper.state is State.RUNNING
    bench.tick(n=200)
    assert bench.stepper.state is State.HOLDING


def test_only_the_clear_of_the_trajectory_that_is_played_stops_it() -> None:
    bench = Bench()
    bench.send(points(4, wave(900), 0, False), n=300)
    clear = np.zeros(1, COMMAND)
    clear["kind"], clear["trajectory"] = LoopCommand.CLEAR, 3
    bench.send(clear, n=5)
    assert bench.stepper.state is State.RUNNING
    clear["trajectory"] = 4
    bench.send(clear, n=1)
    assert bench.stepper.state is State.HOLDING


def test_a_stop_holds_for_five_seconds_and_ramps_then() -> None:
    bench = Bench()
    bench.tick((LoopCommand.SETPOINT, 4.0), n=500)
    first = len(bench.volts)
    bench.tick((LoopCommand.STOP_MOTION, 0.0), n=4900)
    assert bench.stepper.state is State.HOLDING
    assert steps(bench, first + 1).max() == 0.0
    bench.tick(n=200)
    assert 0.0 < steps(bench, len(bench.volts) - 50).max() <= RAMP_V + 1e-9


def test_a_release_ramps_at_once_also_where_nobody_commands() -> None:
    bench = Bench(30.0)
    bench.tick(n=5)
    assert bench.stepper.state is State.READY
    first = len(bench.volts)
    bench.tick((LoopCommand.RELEASE, 0.0), n=100)
    assert steps(bench, first)[1:].min() == pytest.approx(RAMP_V)
    bench.tick(n=700)
    assert bench.stepper.state is State.READY
    assert bench.stepper.volts == 3.0


@pytest.mark.parametrize("volts", [-1.5, 98.0])
def test_an_output_outside_the_limits_stays_until_something_moves_it(volts: float) -> None:
    bench = Bench(volts)
    record = bench.tick(n=200)
    assert bench.stepper.state is State.READY
    assert set(bench.volts) == {volts}
    assert record["flags"] & Flag.RANGE
    first = len(bench.volts)
    bench.tick((LoopCommand.RELEASE, 0.0), n=3000)
    assert bench.stepper.volts == 3.0
    assert steps(bench, first).max() <= RAMP_V + 1e-9


def test_a_new_model_brings_its_own_origin() -> None:
    """With another origin and the same stage, reported positions shift by the origin."""
    bench = Bench()
    bench.tick((LoopCommand.SETPOINT, 4.0), n=500)
    fresh = compensator(model())
    state = fresh.init(0.0)
    for volts in bench.volts:
        fresh.applied(state, volts / GAIN)
    bench.stepper.reload(fresh, state, 1.5)
    record = bench.tick((LoopCommand.SETPOINT, 2.5), n=5)
    assert bench.stepper.origin == 1.5
    assert record["measured"] == pytest.approx(1.0 - 1.5)
    bench.tick(n=400)
    record = bench.tick((LoopCommand.SETPOINT, 2.5), n=100)
    assert record["predicted"] == pytest.approx(2.5, abs=1e-6)
    assert bench.stepper.volts == pytest.approx(bench.volts[500], abs=1e-6)


def test_after_a_fault_the_model_is_led_from_the_output_as_it_was_found() -> None:
    bench = Bench()
    bench.tick((LoopCommand.SETPOINT, 4.0), n=500)
    bench.stepper.fault(bench.now, "unplugged")
    bench.tick(n=10)
    bench.stepper.recover(bench.now, 60.0)
    assert bench.stepper.volts == 60.0
    record = bench.tick()  # the very first sample: an approach would begin from here
    alone = model()
    drives = [*(v / GAIN for v in bench.volts[:511]), 60.0 / GAIN]
    h = np.zeros(8)
    for u in drives:
        h = np.maximum(u - alone.hysteresis.r, np.minimum(u + alone.hysteresis.r, h))
    assert record["predicted"] == pytest.approx(float(alone.hysteresis.b @ h), abs=1e-9)


def test_the_first_step_from_a_reported_output_is_half_as_long() -> None:
    """The first step from a reported output is half a slew step (2000 V/s at 1 kHz: 2 V), because
    the report may be wrong and its error adds to the step."""
    fast = CONFIG + 'on_fault = "hold"\n[setpoint]\napproach_um_per_s = 1e5\n'
    bench = Bench(30.0, fast)
    bench.tick(n=20)
    first = len(bench.volts)
    bench.tick((LoopCommand.SETPOINT, 5.0), n=5)
    assert steps(bench, first)[:3] == pytest.approx([1.0, 2.0, 2.0])
    bench.stepper.fault(bench.now, "unplugged")
    bench.tick(n=10)
    bench.stepper.recover(bench.now, 20.0)
    bench.tick()
    first = len(bench.volts)
    bench.tick((LoopCommand.SETPOINT, 5.0), n=5)
    assert steps(bench, first)[:3] == pytest.approx([1.0, 2.0, 2.0])


def test_a_fault_forgets_the_targets() -> None:
    bench = Bench()
    bench.send(points(4, wave(3000), 0, True), n=500)
    bench.stepper.fault(bench.now, "unplugged")
    bench.tick(n=10)
    held = bench.stepper.volts
    bench.stepper.recover(bench.now, held)
    first = len(bench.volts)
    bench.tick(n=500)
    assert bench.stepper.state is State.READY
    assert steps(bench, first).max() == 0.0
    assert bench.stepper.queue.ahead_s(bench.now) == 0.0


def test_on_fault_ramp_begins_at_once_when_the_device_is_back() -> None:
    bench = Bench(config=CONFIG + 'on_fault = "ramp"\n')
    bench.tick((LoopCommand.SETPOINT, 4.0), n=500)
    bench.stepper.fault(bench.now, "unplugged")
    bench.tick(n=10)
    bench.stepper.recover(bench.now, bench.stepper.volts)
    first = len(bench.volts)
    bench.tick(n=50)
    assert steps(bench, first)[1:].min() == pytest.approx(RAMP_V)


@pytest.mark.parametrize("wild", [np.nan, np.inf, -np.inf, 1e7])
@pytest.mark.parametrize("kind", [LoopCommand.SETPOINT, LoopCommand.POINT])
def test_a_wild_value_that_passed_the_gate_changes_nothing(wild: float, kind: LoopCommand) -> None:
    bench = Bench()
    bench.tick((LoopCommand.SETPOINT, 4.0), n=500)
    first = len(bench.volts)
    bad = np.zeros(1, COMMAND)
    bad["kind"], bad["value"], bad["trajectory"] = kind, wild, 7
    record = bench.send(bad, n=20)
    assert record["target"] == 4.0
    assert steps(bench, first).max() < 1e-6
    assert bench.stepper.events


def test_an_inverse_that_says_nan_leaves_the_output_where_it_is_and_flags_it() -> None:
    """The last check before the amplifier keeps the output if the computed voltage is NaN; here the
    loop's own settings are corrupted."""
    bench = Bench()
    bench.tick((LoopCommand.SETPOINT, 4.0), n=500)
    held = bench.stepper.volts
    bench.stepper._numbers["gain"] = np.nan
    record = bench.tick()
    assert record["volts"] == held
    assert record["flags"] & Flag.RANGE


@pytest.mark.parametrize(("wild_v", "end_v"), [(500.0, 75.0), (-500.0, 0.0)])
def test_the_last_wall_holds_range_and_slew(wild_v: float, end_v: float) -> None:
    """The last check before the amplifier keeps range and slew, even for a safe voltage far outside
    the range and an unlimited ramp, which no configuration can request."""
    bench = Bench(30.0)
    bench.stepper._numbers["safe_v"], bench.stepper._numbers["ramp_v"] = wild_v, 1e6
    bench.tick((LoopCommand.RELEASE, 0.0), n=2)
    for _ in range(60):
        record = bench.tick()
        assert 0.0 <= record["volts"] <= 75.0
        assert record["flags"] & Flag.RANGE
    assert bench.stepper.volts == end_v
    assert steps(bench, 1).max() <= SLEW_V + 1e-9
