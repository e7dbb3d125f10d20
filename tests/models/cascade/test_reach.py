"""The reach of a whole model, compared with the simulation of a slow triangle."""

from dataclasses import replace

import numpy as np
import pytest
from tests.rigs.random_cascades import random_cascade, simulated_reach

from dehyst.models.cascade.reach import displacement_reach, set_point_origin
from dehyst.models.cascade.simulate import simulate
from dehyst.models.model import Block, Hysteresis, Model, Validity
from dehyst.models.physics import PHYSICS

NEAR = 0.005
"""Tolerance as a share of the range."""


@pytest.mark.parametrize("seeds", [range(0, 60), range(60, 120), range(120, 180)], ids=str)
def test_it_is_what_a_slow_triangle_reaches(seeds: range) -> None:
    for seed in seeds:
        model = random_cascade(seed)
        reach = displacement_reach(model, model.validity.drive_min, model.validity.drive_max)
        low, high = simulated_reach(model)
        kinds = [f"{b.kind} at {b.place}" for b in model.blocks]
        assert abs(reach.low - low) <= NEAR * (high - low), (seed, kinds)
        assert abs(reach.high - high) <= NEAR * (high - low), (seed, kinds)


def test_every_physics_is_among_the_random_cascades() -> None:
    drawn = {b.kind for seed in range(180) for b in random_cascade(seed).blocks}
    known = {kind.name for physics in PHYSICS.values() for kind in physics.kinds}
    never = {"one_sided", "coupled_memory", "slow_drift", "lead", "ripple"}  # no specimens
    assert known - drawn <= never


def line(*blocks: Block) -> Model:
    """Return a model of 1 um/V without hysteresis, 0 to 10 V."""
    return Model(
        Hysteresis(r=np.zeros(1), b=np.ones(1), c=np.array([0.0, 1.0])),
        Validity(0.0, 10.0),
        blocks=blocks,
    )


def test_closed_forms() -> None:
    clipped = displacement_reach(line(Block("clip", "drive", {"min_v": 2.0, "max_v": 7.0})), 0, 10)
    assert (clipped.low, clipped.high) == pytest.approx((2.0, 7.0))
    bent = Block("polynomial", "stage", {"coefficients": (1.0, 0.5)})
    bent_reach = displacement_reach(line(bent), 0, 10)
    y = simulate(line(bent), 0.01, np.array([0.0, 10.0]))
    assert (bent_reach.low, bent_reach.high) == pytest.approx((y.min(), y.max()))
    late = displacement_reach(line(Block("lag", "stage", {"tau_s": 0.5})), 0, 10)
    assert (late.low, late.high) == pytest.approx((0.0, 10.0))
    sensor = displacement_reach(line(Block("polynomial", "sensor", dict(bent.params))), 0, 10)
    assert (sensor.low, sensor.high) == pytest.approx((0.0, 10.0))  # targets are the stage's


def test_what_it_takes_for_granted_is_said() -> None:
    assert displacement_reach(line(), 0, 10).assumes == ()
    creep = Block("creep", "stage", {"gain_per_decade": 0.02, "tau_min_s": 0.1, "tau_max_s": 100.0})
    coupled = Block("coupling", "stage", {"gain_um_per_unit": 0.1}, channel="axis.y")
    said = displacement_reach(line(creep, coupled), 0, 10).assumes
    assert len(said) == 2
    assert "creep" in said[0]
    assert "axis.y at its reference" in said[1]


def moved(by: float) -> Model:
    """Return `line` with a sensor that reads so much more [um]."""
    return replace(line(), hysteresis=replace(line().hysteresis, c=np.array([by, 1.0])))


@pytest.mark.parametrize(
    ("choice", "by", "zero"),
    [
        ("model", 2.0, 0.0),
        ("mid-range", 2.0, 5.0),
        ("auto", -1.0, 0.0),
        ("auto", 1.9, 0.0),  # within a fifth of the span beside them
        ("auto", 2.1, 7.1),
        ("auto", 100.0, 105.0),
        (3.5, 0.0, 3.5),
    ],
)
def test_where_set_point_zero_is(choice: str | float, by: float, zero: float) -> None:
    drives = (0.0, 6.0) if choice == "mid-range" else (0.0, 10.0)
    assert set_point_origin(choice, moved(by), *drives) == pytest.approx(zero)


@pytest.mark.parametrize("by", [-1.0, 1.9, 2.1, 100.0])
@pytest.mark.parametrize("choice", ["auto", "model", 3.5])
def test_other_limits_do_not_move_the_coordinates(choice: str | float, by: float) -> None:
    whole = set_point_origin(choice, moved(by), 0.0, 10.0)
    assert [set_point_origin(choice, moved(by), 0.0, most) for most in (1.0, 4.0)] == [whole] * 2
