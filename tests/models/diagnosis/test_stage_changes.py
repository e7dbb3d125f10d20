"""A sudden change of the stage is reported as such, with its time, and nothing slow beside it."""

from dataclasses import replace

import numpy as np
import pytest
from tests.rigs.diagnosis import diagnose_without_limits
from tests.rigs.hardware_stages import RigCase, make_rig
from tests.rigs.outside import plays
from tests.rigs.plants.hysteresis import bouc_wen

from dehyst.models.cascade.history import replay_recording
from dehyst.models.diagnosis import Diagnosis
from dehyst.models.recording import Recording

DT, SECONDS, NOISE = 2e-3, 10.0, 0.01


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


Stage = tuple[RigCase, Diagnosis]
CHANGES_AT = 0.6  # of each recording of a stage whose preload changes


@pytest.fixture(scope="module", params=[4, 16, 28])
def changed(request: pytest.FixtureRequest) -> Stage:
    """Return stages whose gain and level change in each of three, two and one recordings."""
    rig = make_rig(415823, request.param)
    assert rig.kind == "preload"
    return rig, diagnose_without_limits(rig.given)


def test_a_sudden_change_is_told_with_its_time_and_no_slow_physics(changed: Stage) -> None:
    rig, found = changed
    assert found.verdict in ("unknown", "partly")
    assert {f.name for f in found.findings} - {"shape"} == {"unknown"}
    change = next(f for f in found.findings if f.name == "unknown")
    for one in rig.given:
        stated = change.says.partition(f" s of {one.name}")[0].rpartition("at ")[2]
        assert float(stated) == pytest.approx(CHANGES_AT * one.t_s[-1], abs=0.1)
    (place,) = [one for one in rig.given if one.name == change.where["recording"]]
    assert change.where["from_s"] == pytest.approx(CHANGES_AT * place.t_s[-1], abs=0.1)


def test_the_written_model_is_judged_by_the_readings_as_they_are(changed: Stage) -> None:
    rig, found = changed
    for one in rig.given:
        assert one.displacement is not None
        left = [
            np.std(one.displacement - replay_recording(model, one).predicted)
            for model in (found.base_model, found.model)
        ]
        assert left[1] < left[0] + 0.5 * rig.noise


def test_a_change_that_lasts_is_told_once() -> None:
    """The gain changes in the second of three recordings, and the third one has it from its
    beginning."""
    given = []
    for k in range(3):
        one = at_rest(k, f"{k}")
        assert one.displacement is not None
        more = 0.04 * (k + one.t_s / SECONDS > 1.0 + CHANGES_AT)
        given.append(replace(one, displacement=one.displacement * (1.0 + more)))
    (change,) = (f for f in diagnose_without_limits(given).findings if f.name == "unknown")
    assert change.where["recording"] == "1"
    assert change.where["from_s"] == pytest.approx(CHANGES_AT * SECONDS, abs=0.1)
    assert change.says.count("its gain changes by") == 1
    stated = change.says.partition("its gain changes by ")[2].partition(" %")[0]
    assert float(stated) == pytest.approx(4.0, abs=0.3)


def test_a_change_is_not_told_where_its_gain_and_its_level_cannot_be_told_apart() -> None:
    """Two recordings change. In a third one, which rests for most of its time, a little slips: its
    gain from then on is not known, as a level with any gain fits it."""
    given = []
    for k, gain in enumerate((0.2, -0.2, 0.0)):
        one = at_rest(k, f"{k}")
        rests = (k == 2) & (one.t_s > 0.2 * SECONDS)
        u = np.where(rests, one.drive[round(0.2 * SECONDS / DT)], one.drive)
        late = one.t_s > CHANGES_AT * SECONDS
        y = bouc_wen(np.random.default_rng(5))(u) * (1.0 + gain * late) + 0.12 * (k == 2) * late
        noise = NOISE * np.random.default_rng(k).standard_normal(u.size)
        given.append(replace(one, drive=u, displacement=y + noise))
    (change,) = (f for f in diagnose_without_limits(given).findings if f.name == "unknown")
    assert " s of 0 its gain changes by +" in change.says
    assert " s of 1 its gain changes by -" in change.says
    assert " s of 2" not in change.says


def test_a_gauge_whose_zero_jumps_is_no_change_of_the_loop() -> None:
    """The model in use is identified from the recording with the jump in it."""
    t = DT * np.arange(2000)
    u = 50.0 - 50.0 * np.cos(2 * np.pi * 1.5 * t) * (1.0 - 0.5 * t / t[-1])
    y = plays(u, np.array([0.0, 6.0, 15.0, 30.0]), np.array([0.05, 0.02, 0.02, 0.01]))
    y += 3.0 * (t > 0.6 * t[-1])
    noise = 0.004 * np.random.default_rng(1).standard_normal(t.size)
    found = diagnose_without_limits([Recording(t, u, y + noise, name="a.csv")])
    (finding,) = found.findings
    assert finding.name == "unknown"
    assert finding.share > 0.95
    assert finding.where["from_s"] == pytest.approx(0.6 * t[-1], abs=0.05)


def test_a_ramp_is_no_sudden_change() -> None:
    ramps = []
    for seed in range(2):
        one = at_rest(seed, f"{seed}")
        assert one.displacement is not None
        ramps.append(replace(one, displacement=one.displacement + 0.03 * one.t_s))
    names = [f.name for f in diagnose_without_limits(ramps).findings]
    assert "drift" in names
    assert "unknown" not in names


def test_a_stage_that_follows_a_temperature_does_not_change_suddenly() -> None:
    """Most of the warming takes half a second of ten, so a step removes nearly all of it."""
    warmed = []
    for seed, half_way in enumerate((4.5, 5.5)):
        one = at_rest(seed, f"{seed}")
        assert one.displacement is not None
        warmth = np.tanh((one.t_s - half_way) / 0.3)
        y = one.displacement + 0.6 * warmth
        warmed.append(replace(one, displacement=y, channels={"temp_c": 21.0 + warmth}))
    found = diagnose_without_limits(warmed)
    assert [f.name for f in found.findings if f.name != "shape"] == ["drift"]


def test_what_a_base_fits_of_the_noise_is_no_sudden_change() -> None:
    """Eight hundred readings, and a base of a hundred columns: creep through a polled gauge."""
    rig = make_rig(917351, 29)
    assert (rig.kind, rig.hidden) == ("polled", ("creep",))
    assert not any(
        "changes suddenly" in f.says for f in diagnose_without_limits(rig.given).findings
    )
