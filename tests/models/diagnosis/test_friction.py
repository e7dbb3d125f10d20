"""Friction that decreases with the speed: the bristle model against small steps, and a stage that
runs back at its turns."""

import numpy as np
import pytest
from tests.models.diagnosis.test_rate import diagnosed
from tests.rigs.blocks import forward

from dehyst.models.diagnosis.data.prepare import prepare
from dehyst.models.physics import list_candidates
from dehyst.models.recording import Recording

DT = 1e-3


def rubbed(x: np.ndarray, most: float, stribeck: float) -> np.ndarray:
    """Return by how much friction of 0.8 um holds back a path (N,), in 40 small steps per sample:
    the LuGre model with a static friction that is 1.9 times the one at high speed."""
    out, z, fine = np.zeros(x.size), 0.0, 40
    for t in range(1, x.size):
        step, speed = (x[t] - x[t - 1]) / fine, (x[t] - x[t - 1]) / DT
        g = most * (1.0 + 0.9 * np.exp(-((speed / stribeck) ** 2)))
        for _ in range(fine):
            z += step - abs(step) * z / g
        out[t] = 0.8 * z / most
    return out


def running_back(u: np.ndarray, y: np.ndarray) -> np.ndarray:
    """Return the displacement of a stage that runs back: at a turn the friction decreases by more
    than the path advances."""
    return y - rubbed(y, 0.15, 40.0)


def viscous(u: np.ndarray, y: np.ndarray) -> np.ndarray:
    """Return the same on a greased guide: a part that grows with the speed is as large at the
    speeds of this drive."""
    return running_back(u, y) - 2e-3 * np.gradient(y, DT)


@pytest.mark.parametrize("viscous_s", [0.0, 3e-3])
def test_bristles_are_those_of_small_steps(viscous_s: float) -> None:
    t = np.arange(3000) * DT
    u = 4.0 - 3.0 * np.cos(9.0 * t) + 0.4 * np.sin(50.0 * t)
    speed = 27.0 * np.sin(9.0 * (t - DT / 2)) + 20.0 * np.cos(50.0 * (t - DT / 2))
    speed[0] = 0.0  # a block starts at rest at its first input
    values = {"length": 0.15, "stribeck": 40.0, "excess": 0.9, "sliding": 0.8}
    got = forward("bristles", u, t, gain=2.0, viscous=viscous_s, **values)
    want = -rubbed(2.0 * u, 0.15, 40.0) - viscous_s * 2.0 * speed
    assert got == pytest.approx(want, abs=0.02)


def test_a_jump_of_the_drive_is_not_faster_than_what_was_recorded() -> None:
    """The viscous part of a speed that nobody recorded would be as large as the whole stroke."""
    t, u = np.arange(100) * DT, np.where(np.arange(100) < 50, 0.0, 40.0)
    values = {"length": 0.15, "stribeck": 40.0, "excess": 0.5, "sliding": 0.4, "viscous": 1e-3}
    got = forward("bristles", u, t, gain=2.0, fastest=300.0, **values)
    assert abs(got[50]) < 0.4 * 1.5 + 1e-3 * 300.0 + 1e-9
    assert abs(forward("bristles", u, t, gain=2.0, **values)[50]) > 60.0


@pytest.mark.parametrize("law", [running_back, viscous])
def test_friction_on_a_stage_that_runs_back_at_its_turns_is_reported(law: object) -> None:
    d = diagnosed(law)
    reported = [f for f in d.findings if f.name != "shape"]
    assert [f.name for f in reported] == ["friction"]
    before, after = d.before_after
    assert after < 0.055 * before
    assert reported[0].parameters["stribeck_um_per_s"].value == pytest.approx(40.0, rel=0.5)


@pytest.mark.parametrize(
    ("fades_um", "viscous_s", "is_friction"),
    [(0.4, 0.0, True), (0.4, 2e-3, True), (-0.4, 2e-3, False), (0.02, 2e-3, False),
     (0.4, -2e-3, False), (0.4, -1e-4, True)],
)  # fmt: skip
def test_friction_fades_with_the_speed_and_what_only_grows_with_it_is_a_lag(
    fades_um: float, viscous_s: float, is_friction: bool
) -> None:
    t = np.arange(4000) * DT
    u = 5.0 - 4.0 * np.cos(20.0 * t)  # 88 um/s at most, 62 rms
    data = prepare([Recording(t, u, 1.1 * u, name="r.csv")])
    friction = next(c for c in list_candidates(data) if c.key == "friction")
    amplitudes = np.array([fades_um / 0.5, viscous_s])
    assert (friction.implausible((0.1, 20.0), amplitudes, data) == "") == is_friction
