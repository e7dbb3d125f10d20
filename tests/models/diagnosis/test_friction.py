"""Friction that fades with the speed: bristles against small steps, and a stage that runs back."""

import numpy as np
import pytest
from tests.models.diagnosis.test_rate import diagnosed

from dehyst.models.physics import KINDS

DT = 1e-3


def rubbed(x: np.ndarray, most: float, stribeck: float) -> np.ndarray:
    """What friction of 0.8 um holds back a path (N,), in 40 small steps to a sample: LuGre with a
    friction at rest that is 1.9 times the one at high speed."""
    out, z, fine = np.zeros(x.size), 0.0, 40
    for t in range(1, x.size):
        step, speed = (x[t] - x[t - 1]) / fine, (x[t] - x[t - 1]) / DT
        g = most * (1.0 + 0.9 * np.exp(-((speed / stribeck) ** 2)))
        for _ in range(fine):
            z += step - abs(step) * z / g
        out[t] = 0.8 * z / most
    return out


def running_back(u: np.ndarray, y: np.ndarray) -> np.ndarray:
    """At a turn the friction gives way by more than the path moves on: the displacement of the
    stage runs back."""
    return y - rubbed(y, 0.15, 40.0)


def test_bristles_are_those_of_small_steps() -> None:
    t = np.arange(3000) * DT
    u = 4.0 - 3.0 * np.cos(9.0 * t) + 0.4 * np.sin(50.0 * t)
    values = {"length": 0.15, "stribeck": 40.0, "excess": 0.9, "sliding": 0.8}
    got = KINDS["bristles"].forward(u, t, gain=2.0, **values)
    assert got == pytest.approx(-rubbed(2.0 * u, 0.15, 40.0), abs=0.02)


def test_friction_on_a_stage_that_runs_back_at_its_turns_is_told() -> None:
    d = diagnosed(running_back)
    told = [f for f in d.findings if f.name != "shape"]
    assert [f.name for f in told] == ["friction"]
    before, after = d.before_after
    assert after < 0.5 * before
    assert told[0].parameters["stribeck_um_per_s"].value == pytest.approx(40.0, rel=0.5)
