"""Trajectories that several axes play together, sample by sample, in both engines."""

import itertools

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from tests.rigs.trio import Trio, group_points
from tests.rigs.two_loops import setpoint

from dehyst.daemon.rings.records import COMMAND, Flag, LoopCommand, State

names = (f"group-{i}" for i in itertools.count())
N = 400
RAMP_X = 1.0 + 0.01 * np.arange(N)
RAMP_Y = 9.0 - 0.02 * np.arange(N)
APPROACH = int(Flag.APPROACH)


def order(kind: LoopCommand, value: float = 0.0) -> np.ndarray:
    batch = np.zeros(1, COMMAND)
    batch["kind"], batch["value"], batch["trajectory"] = kind, value, 5
    return batch


def moving(records: dict[str, np.ndarray], axis: str, ramp: np.ndarray) -> np.ndarray:
    """Return the time in the trajectory [samples] to which each sample's target belongs."""
    target = records[axis]["target"]
    return (target - ramp[0]) / (ramp[1] - ramp[0])


@pytest.mark.parametrize("compiled", [False, True])
def test_they_start_together_however_far_their_ways_are(compiled: bool) -> None:
    trio = Trio(next(names), "xy")
    # x needs 5 ms (1 um at 200 um/s), y 45 ms (9 um): x waits at its first point
    reported = trio.play(
        {"x": group_points(RAMP_X, last=True), "y": group_points(RAMP_Y, last=True)}, 600, compiled
    )
    x, y = reported["x"]["target"], reported["y"]["target"]
    start = int(np.flatnonzero(x > RAMP_X[0] + 1e-9)[0])
    assert start == int(np.flatnonzero((y < RAMP_Y[0] - 1e-9) & (np.arange(600) > 46))[0])
    assert start >= 45
    np.testing.assert_allclose(x[8:start], RAMP_X[0])
    # from there on each axis is at its own point of the same time, in every sample
    np.testing.assert_allclose(x[start : start + N - 2], RAMP_X[1:-1], atol=1e-9)
    np.testing.assert_allclose(y[start : start + N - 2], RAMP_Y[1:-1], atol=1e-9)
    assert (reported["x"]["flags"][10 : start - 1] & APPROACH).all()
    assert not (reported["x"]["flags"][start:] & APPROACH).any()


def test_while_one_has_no_points_all_stand_still_and_nothing_jumps() -> None:
    trio = Trio(next(names), "xyz")
    ramp_z = 4.0 + 0.015 * np.arange(N)
    more = {"members": 3}
    reported = [
        trio.play(
            {
                "x": group_points(RAMP_X, **more, last=True),
                "y": group_points(RAMP_Y[:50], **more),
                "z": group_points(ramp_z[:200], **more),
            },
            140,
        )
    ]
    # y runs dry at its 50th point; it receives points up to the 120th, then up to its end
    reported.append(trio.play({"y": group_points(RAMP_Y[50:120], **more, first=50)}, 40))
    reported.append(trio.play({"z": group_points(ramp_z[200:], **more, first=200, last=True)}, 60))
    reported.append(trio.play({"y": group_points(RAMP_Y[120:], **more, first=120, last=True)}, 400))
    whole = {axis: np.concatenate([part[axis] for part in reported]) for axis in "xyz"}
    start = int(np.flatnonzero(np.diff(whole["x"]["target"]) > 0.005)[5])
    at = [
        moving(whole, axis, ramp)[start:600]
        for axis, ramp in (("x", RAMP_X), ("y", RAMP_Y), ("z", ramp_z))
    ]
    np.testing.assert_allclose(at[0], at[1], atol=1e-6)
    np.testing.assert_allclose(at[0], at[2], atol=1e-6)
    steps = np.diff(at[0])
    assert np.isclose(steps, 1.0).sum() + np.isclose(steps, 0.0).sum() == steps.size
    assert np.isclose(at[0][139 - start], 49.0)  # stood still at y's last point
    assert np.isclose(at[0], 119.0).sum() > 2  # and a second time
    assert at[0][-1] == pytest.approx(N - 1)
    assert any("has run dry" in text for text in trio.events("y"))
    assert any("until the other axes" in text for text in trio.events("x"))
    assert not any("has run dry" in text for text in trio.events("x"))


def test_one_that_stays_dry_makes_all_hold() -> None:
    trio = Trio(next(names), "xy")
    reported = trio.play(
        {"x": group_points(RAMP_X, last=True), "y": group_points(RAMP_Y[:20])}, 400
    )
    for axis in "xy":
        assert State(reported[axis]["state"][-1]) in (State.HOLDING, State.READY)
    assert np.nanmax(reported["x"]["target"]) == pytest.approx(RAMP_X[19])


@pytest.mark.parametrize("compiled", [False, True])
@pytest.mark.parametrize("why", [LoopCommand.RELEASE, LoopCommand.STOP_MOTION, LoopCommand.CLEAR])
def test_when_one_leaves_the_others_hold(compiled: bool, why: LoopCommand) -> None:
    trio = Trio(next(names), "xyz")
    z = setpoint(3.0)
    begun = {"x": group_points(RAMP_X, last=True), "y": group_points(RAMP_Y, last=True), "z": z}
    trio.play(begun, 120, compiled)
    reported = trio.play({"y": order(why), "z": z}, 4, compiled)
    assert State(reported["x"]["state"][-1]) is State.HOLDING
    assert np.ptp(reported["x"]["volts"][1:]) == 0.0
    assert State(reported["z"]["state"][-1]) is State.RUNNING  # z is not part of the group
    assert any("another axis of the trajectory has left" in text for text in trio.events("x"))
    # points that arrive too late for the trajectory move nothing and do not restart the hold
    said = len(trio.events("x"))
    reported = trio.play({"x": group_points(RAMP_X, first=900)}, 5, compiled)
    assert State(reported["x"]["state"][-1]) is State.HOLDING
    assert np.ptp(reported["x"]["volts"]) == 0.0
    assert len(trio.events("x")) == said


@pytest.mark.parametrize("compiled", [False, True])
def test_a_fault_of_one_makes_the_others_hold(compiled: bool) -> None:
    trio = Trio(next(names), "xy")
    trio.play(
        {"x": group_points(RAMP_X, last=True), "y": group_points(RAMP_Y, last=True)}, 120, compiled
    )
    trio.rigs["y"].stage.plugged = False
    reported = trio.play({}, 4, compiled)
    assert State(reported["y"]["state"][-1]) is State.FAULT
    assert State(reported["x"]["state"][-1]) is State.HOLDING


def test_a_setpoint_to_one_of_them_makes_the_others_hold() -> None:
    trio = Trio(next(names), "xy")
    trio.play({"x": group_points(RAMP_X, last=True), "y": group_points(RAMP_Y, last=True)}, 120)
    reported = trio.play({"y": setpoint(4.0)}, 4)
    assert State(reported["x"]["state"][-1]) is State.HOLDING
    assert State(reported["y"]["state"][-1]) is State.RUNNING


def test_without_the_others_nobody_starts() -> None:
    trio = Trio(next(names), "xy")
    reported = trio.play({"x": group_points(RAMP_X, last=True)}, 60)["x"]
    assert np.nanmax(reported["target"]) == pytest.approx(RAMP_X[0])
    reported = trio.play({}, 200)["x"]
    assert State(reported["state"][-1]) in (State.HOLDING, State.READY)
    assert np.nanmax(reported["target"]) == pytest.approx(RAMP_X[0])


def test_a_stage_of_one_axis_waits_for_nobody_for_ever() -> None:
    trio = Trio(next(names), "x")
    reported = trio.play({"x": group_points(RAMP_X, last=True)}, 300)["x"]
    assert State(reported["state"][-1]) in (State.HOLDING, State.READY)
    assert np.nanmax(reported["target"]) == pytest.approx(RAMP_X[0])


def test_one_that_has_played_to_its_end_may_go() -> None:
    trio = Trio(next(names), "xy")
    trio.play(
        {"x": group_points(RAMP_X, last=True), "y": group_points(RAMP_Y[:60], last=True)}, 200
    )
    reported = trio.play({"y": order(LoopCommand.RELEASE)}, 20)
    assert State(reported["x"]["state"][-1]) is State.RUNNING


lengths = st.lists(st.integers(2, 60), min_size=1, max_size=4)


@pytest.mark.parametrize("mode", ["static", "preview"])
@settings(max_examples=12, deadline=None)
@given(
    st.lists(st.tuples(st.sampled_from("xyz"), st.integers(1, 60)), min_size=1, max_size=8),
    st.lists(st.integers(0, 2_500_000), min_size=1, max_size=5),
)
def test_both_engines_give_the_same_records_of_all_axes(
    mode: str, feeds: list[tuple[str, int]], late: list[int]
) -> None:
    trios = [Trio(next(names), "xyz", mode, late) for _ in range(2)]
    sent = dict.fromkeys("xyz", 0)
    wave = 5.0 + 3.0 * np.sin(0.02 * np.arange(600))
    for axis, count in feeds:
        part = wave[sent[axis] : sent[axis] + count]
        batch = group_points(part, members=3, first=sent[axis])
        sent[axis] += count
        one, other = (trio.play({axis: batch}, 40, bool(i)) for i, trio in enumerate(trios))
        for name in "xyz":
            for records in (one, other):
                records[name]["cause"] = 0
            assert one[name].tobytes() == other[name].tobytes()
            assert (one[name]["scheduled_ns"] == one["x"]["scheduled_ns"]).all()
    assert trios[0].events("x") == trios[1].events("x")
