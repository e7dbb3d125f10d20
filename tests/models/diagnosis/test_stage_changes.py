"""A sudden change of the stage is reported as such, with its time, and nothing slow beside it."""

from dataclasses import replace

import numpy as np
import pytest
from tests.rigs.diagnosis import diagnose_without_limits
from tests.rigs.plants.hysteresis import bouc_wen

from dehyst.models.cascade.history import replay_recording
from dehyst.models.diagnosis import Diagnosis
from dehyst.models.recording import Recording

DT, SECONDS, NOISE = 2e-3, 10.0, 0.01
CHANGES_AT_S = {"first": 6.0, "second": 3.5}


def at_rest(seed: int, name: str) -> Recording:
    """Return a recording of a Bouc-Wen stage that stays as it is."""
    rng = np.random.default_rng(seed)
    t = DT * np.arange(round(SECONDS / DT))
    waves = [(hz, rng.uniform(0.3, 1.0), rng.uniform(0.0, 6.28)) for hz in (0.4, 1.1, 2.7, 5.3)]
    u = sum(a * np.sin(2 * np.pi * hz * t + p) for hz, a, p in waves)
    u = 5.0 + 4.0 * u / np.max(np.abs(u)) * np.minimum(1.0, 4.0 * t)
    u = u - u[0] * np.exp(-5.0 * t)
    y = bouc_wen(np.random.default_rng(5))(u)
    return Recording(t, u, y + NOISE * rng.standard_normal(u.size), name=name)


def changed(gain: float, level: float) -> list[Recording]:
    """Return two recordings in which the stage changes suddenly."""
    out = []
    for seed, (name, at_s) in enumerate(CHANGES_AT_S.items()):
        one = at_rest(seed, name)
        assert one.displacement is not None
        y = one.displacement * (1.0 + gain * (one.t_s > at_s)) + level * (one.t_s > at_s)
        out.append(replace(one, displacement=y))
    return out


@pytest.fixture(scope="module", params=[(0.03, 0.0), (0.0, 0.2), (0.01, 0.1)])
def found(request: pytest.FixtureRequest) -> Diagnosis:
    return diagnose_without_limits(changed(*request.param))


def test_a_sudden_change_is_told_with_its_time_and_no_slow_physics(found: Diagnosis) -> None:
    assert found.verdict in ("unknown", "partly")
    assert {f.name for f in found.findings} - {"shape"} == {"unknown"}
    change = next(f for f in found.findings if f.name == "unknown")
    assert change.where["from_s"] == pytest.approx(CHANGES_AT_S[change.where["recording"]], abs=0.1)
    for name, at_s in CHANGES_AT_S.items():
        told = float(change.says.partition(f" s of {name}")[0].rpartition("at ")[2])
        assert told == pytest.approx(at_s, abs=0.1)


def test_the_written_model_is_judged_by_the_readings_as_they_are(found: Diagnosis) -> None:
    for one in changed(0.03, 0.0):
        assert one.displacement is not None
        left = [
            np.std(one.displacement - replay_recording(model, one).predicted)
            for model in (found.base_model, found.model)
        ]
        assert left[1] < left[0] + 0.5 * NOISE


def test_a_ramp_is_no_sudden_change() -> None:
    ramps = []
    for seed in range(2):
        one = at_rest(seed, f"{seed}")
        assert one.displacement is not None
        ramps.append(replace(one, displacement=one.displacement + 0.03 * one.t_s))
    names = [f.name for f in diagnose_without_limits(ramps).findings]
    assert "drift" in names
    assert "unknown" not in names
