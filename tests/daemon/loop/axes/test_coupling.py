"""One axis compensates its coupling to another one in the same sample, checked with the plant's own
equation."""

import itertools
from collections.abc import Mapping

import numpy as np
import pytest
from tests.rigs.trio import Trio, group_points
from tests.rigs.two_loops import model, setpoint

from dehyst.models.hysteresis.forward import simulate_hysteresis
from dehyst.models.model import Block

names = (f"coupled-{i}" for i in itertools.count())
GAIN = 0.05
N = 500
BEGUN = 100  # both axes have reached their first points
WAVE = 6.0 + 3.0 * np.sin(0.03 * np.arange(N))
BOTH = pytest.mark.parametrize("compiled", [False, True])


def following(channel: str, gain: float = GAIN) -> tuple[Block, ...]:
    return (Block("coupling", "stage", {"gain_um_per_unit": gain}, channel),)


def by_its_drive(records: np.ndarray) -> np.ndarray:
    """Return the displacement due to the drive alone, one period after each sample, from the virgin
    stage."""
    volts = np.concatenate([[0.0], records["volts"]])
    return simulate_hysteresis(model().hysteresis, volts, 1e-3)[1:]


def played(
    blocks: Mapping[str, tuple[Block, ...]], compiled: bool, axes: str = "xy"
) -> dict[str, np.ndarray]:
    """Hold x at 8 um while y plays the wave; return the records by axis."""
    trio = Trio(next(names), axes, blocks=blocks)
    y = group_points(WAVE, group=0, last=True)
    x = np.concatenate([setpoint(8.0)])
    parts = [trio.play({"x": x, "y": y}, 90, compiled)]
    for _ in range(9):
        parts.append(trio.play({"x": setpoint(8.0)}, 45, compiled))
    return {a: np.concatenate([part[a] for part in parts]) for a in axes}


@BOTH
@pytest.mark.parametrize("axes", ["xy", "yx"])
def test_the_displacement_of_another_axis_is_taken_out_in_the_same_sample(
    compiled: bool, axes: str
) -> None:
    reported = played({"x": following("axis.y")}, compiled, axes)
    # y's target one period later is where y will be when this voltage takes effect
    there = by_its_drive(reported["x"])[:-1] + GAIN * reported["y"]["target"][1:]
    assert np.ptp(reported["y"]["target"][BEGUN:]) > 5.0
    assert np.abs(there[BEGUN:] - 8.0).max() < 1e-6


@BOTH
@pytest.mark.parametrize("axes", ["xy", "yx"])
def test_the_drive_of_another_axis_is_that_of_the_same_sample(compiled: bool, axes: str) -> None:
    reported = played({"x": following("axis.y.drive", 0.004)}, compiled, axes)
    there = by_its_drive(reported["x"]) + 0.004 * reported["y"]["volts"]
    assert np.abs(there[BEGUN:] - 8.0).max() < 1e-6


@pytest.mark.parametrize("points", [False, True])
def test_the_other_axis_counts_from_its_models_zero_whatever_its_set_points_do(
    points: bool,
) -> None:
    """x reaches its target also if y's set-points have their origin at 5 um: the coupling counts
    from the model's zero, as in a recording of the gauge."""
    trio = Trio(next(names), "xy", blocks={"x": following("axis.y")}, origins={"y": 5.0})
    y = group_points(WAVE - 5.0, group=0, last=True) if points else setpoint(3.0)
    reported = trio.play({"x": setpoint(8.0), "y": y}, 90)
    there = by_its_drive(reported["x"])[:-1] + GAIN * (reported["y"]["target"][1:] + 5.0)
    assert np.abs(reported["y"]["target"][-1] + 5.0) > 5.0
    assert np.abs(there[70:] - 8.0).max() < 1e-6


@BOTH
def test_both_directions_at_once(compiled: bool) -> None:
    reported = played({"x": following("axis.y"), "y": following("axis.x", -0.03)}, compiled)
    x = by_its_drive(reported["x"])[:-1] + GAIN * reported["y"]["target"][1:]
    y = by_its_drive(reported["y"])[:-1] - 0.03 * reported["x"]["target"][1:]
    assert np.abs(x[BEGUN:] - 8.0).max() < 1e-6
    assert np.abs(y - reported["y"]["target"][1:])[BEGUN:450].max() < 1e-6


@BOTH
def test_in_a_circle_the_first_takes_the_drive_of_the_sample_before(compiled: bool) -> None:
    reported = played(
        {"x": following("axis.y.drive", 0.004), "y": following("axis.x.drive", 0.003)}, compiled
    )
    x = by_its_drive(reported["x"])[1:] + 0.004 * reported["y"]["volts"][:-1]
    y = by_its_drive(reported["y"]) + 0.003 * reported["x"]["volts"]
    assert np.abs(x[BEGUN:] - 8.0).max() < 1e-6
    assert np.abs(y[:-1] - reported["y"]["target"][1:])[BEGUN:450].max() < 1e-6


@BOTH
def test_an_axis_without_a_target_counts_where_its_model_has_it(compiled: bool) -> None:
    trio = Trio(next(names), "xy", blocks={"x": following("axis.y")})
    parts = [trio.play({"x": setpoint(8.0), "y": setpoint(9.0)}, 90, compiled)]
    parts += [trio.play({"x": setpoint(8.0)}, 45, compiled) for _ in range(6)]  # y is stale, ramps
    reported = {a: np.concatenate([part[a] for part in parts]) for a in "xy"}
    assert np.ptp(reported["y"]["volts"]) > 40.0
    used = trio.rigs["x"].stepper.inverse.channels[0]
    assert used == pytest.approx(reported["y"]["predicted"][-1], abs=1e-9)
    # one sample late, but continuous: x does not step when y loses its target
    there = by_its_drive(reported["x"])[1:-1] + GAIN * reported["y"]["predicted"][1:-1]
    assert np.abs(there[BEGUN:] - 8.0).max() < 1e-6
