"""The subject of a diagnosis is the model in use: its error, what explains it, what is left, with
the same two figures that `simulate` gives. Stages are integrated here, by no equation of the
library."""

from dataclasses import replace

import numpy as np
import pytest
from tests.rigs.diagnosis import diagnose_without_limits
from tests.rigs.plants.hysteresis import maxwell_slip

from dehyst.models import modelfile
from dehyst.models.cascade.simulate import simulate
from dehyst.models.diagnosis import Diagnosis
from dehyst.models.diagnosis.data.prepare import prepare
from dehyst.models.diagnosis.diagnosed_model import (
    THRESHOLDS,
    fit_plain_model,
    identify_plain_model,
)
from dehyst.models.errors import BadInput
from dehyst.models.identify import Options, identify
from dehyst.models.model import Block, Hysteresis, Model, Validity
from dehyst.models.recording import Recording

DT, NOISE_UM, N = 1e-3, 0.02, 8000


def drive(k: int) -> np.ndarray:
    """Return lines of 0.4 to 21 Hz in 0 to 10 V that begin at rest, another set for each k."""
    t = np.arange(N) * DT
    lines = ((2.2, 0.4 + 0.3 * k, 0.3), (1.0, 3.1 - k, 1.0), (0.6, 9.0 + k, 2.0), (0.3, 21.0, 0.1))
    u = sum(a * np.sin(2 * np.pi * f * t + p + k) for a, f, p in lines)
    return (5 + u * 4.6 / np.abs(u).max()) * np.clip(t / 0.4, 0, 1)


def dead_bands(u: np.ndarray, halves: tuple[float, ...], weights: tuple[float, ...]) -> np.ndarray:
    """Sum dead bands by brute force."""
    out = np.zeros(u.size)
    for half, weight in zip(halves, weights, strict=True):
        p = 0.0
        for i, v in enumerate(u.tolist()):
            p = max(v - half, min(v + half, p))
            out[i] += weight * p
    return out


def plain(u: np.ndarray) -> np.ndarray:
    """Return a stage of the model's own class: five dead bands and a cubic."""
    z = dead_bands(u, (0.0, 0.2, 0.7, 1.5, 2.6), (0.8, 0.08, 0.1, 0.08, 0.06))
    return z - 0.004 * z**2


def one_sided(u: np.ndarray) -> np.ndarray:
    """Return the same with a loop that bends on its rising branch only."""
    ahead = np.maximum(u - dead_bands(u, (1.2,), (1.0,)), 0.0)
    return plain(u) + 0.25 * ahead**2


def curved_sensor(u: np.ndarray) -> np.ndarray:
    """Return the same, read by a sensor whose error is a wave of 3 um along the range."""
    x = plain(u)
    return x + 0.12 * np.sin(2 * np.pi * x / 3.0)


def recordings(stage: object, late_s: float = 0.0, seed: int = 0) -> list[Recording]:
    rng, t = np.random.default_rng(seed), np.arange(N) * DT
    out = []
    for k in range(2):
        u = drive(k)
        y = stage(np.interp(t - late_s, t, u)) + NOISE_UM * rng.standard_normal(N)  # type: ignore[operator]
        out.append(Recording(t, u, y, name=f"r{k}.csv"))
    return out


def simulated_rms(model: Model, one: Recording) -> float:
    """Return the rms residual of the simulated written model, without its mean."""
    e = one.displacement - simulate(modelfile.loads(modelfile.dumps(model)), one.t_s, one.drive)
    return float(np.std(e))


def check_figures(d: Diagnosis, given: list[Recording]) -> None:
    for which, model in (("model", d.base_model), ("augmented", d.model)):
        for one in given:
            assert d.rms[which][one.name] == pytest.approx(simulated_rms(model, one), rel=1e-3)
    pooled = [np.sqrt(np.mean(np.square(list(d.rms[k].values())))) for k in ("model", "augmented")]
    assert d.before_after == pytest.approx(tuple(pooled), rel=1e-3)
    assert 0.0 <= sum(f.share for f in d.findings) <= 1.0 + 1e-9


@pytest.mark.parametrize("stage", [one_sided, curved_sensor], ids=["asymmetric", "sensor"])
def test_what_the_base_explains_and_the_model_does_not_is_shape(stage: object) -> None:
    given = recordings(stage)
    d = diagnose_without_limits(given)
    check_figures(d, given)
    before, after = d.before_after
    assert before > 2.0 * NOISE_UM
    assert after < 1.15 * NOISE_UM
    assert d.verdict == "explained"
    first = d.findings[0]
    assert first.name in ("shape", "sensor", "asymmetry")
    if first.name == "shape":
        assert {"asymmetry", "sensor"} <= set(first.ambiguous_with)
        assert first.place == "stage"


def test_a_stage_of_the_models_own_class_is_clean_and_the_model_stays() -> None:
    given = recordings(plain)
    d = diagnose_without_limits(given)
    check_figures(d, given)
    assert (d.verdict, d.findings) == ("clean", ())
    assert d.before_after[0] < 1.1 * NOISE_UM
    np.testing.assert_array_equal(d.model.hysteresis.b, d.base_model.hysteresis.b)
    assert d.model.blocks == ()


def test_a_delay_on_a_stage_of_the_models_class_is_no_shape() -> None:
    d = diagnose_without_limits(recordings(plain, late_s=2.5e-3))
    assert [f.name for f in d.findings] == ["delay"]
    assert d.findings[0].parameters["delay_s"].value == pytest.approx(2.5e-3, rel=0.05)


def test_the_given_model_is_what_is_diagnosed() -> None:
    """A model with the stage's delay leaves nothing; one with half of it lacks the other half."""
    given = recordings(plain, late_s=4e-3)
    own = identify(recordings(plain), Options(rate=False)).model
    for held, names in ((4e-3, []), (2e-3, ["delay"])):
        model = replace(own, blocks=(Block("delay", "drive", {"delay_s": held}),))
        d = diagnose_without_limits(given, model)
        check_figures(d, given)
        assert [f.name for f in d.findings] == names
        assert d.base_model is model
        assert d.before_after[1] < 1.1 * NOISE_UM
        if names:
            assert d.findings[0].parameters["delay_s"].value == pytest.approx(2e-3, rel=0.05)


def test_a_model_with_other_numbers_is_reported_to_be_identified_again() -> None:
    given = recordings(plain)
    own = identify(given, Options(rate=False)).model
    h = own.hysteresis
    worn = replace(own, hysteresis=replace(h, b=h.b * np.linspace(1.0, 1.15, h.n)))
    d = diagnose_without_limits(given, worn)
    check_figures(d, given)
    (shape,) = d.findings
    assert shape.name == "shape"
    assert "dentify again" in shape.says
    assert d.before_after[1] < 1.1 * NOISE_UM


def test_a_model_of_another_stage_is_reported_first() -> None:
    given = recordings(maxwell_slip(np.random.default_rng(1)))
    other = Model(
        Hysteresis(r=np.array([0.0, 1.0]), b=np.array([2.4, 0.3]), c=np.array([0.0, 1.0])),
        Validity(0.0, 10.0),
    )
    d = diagnose_without_limits(given, other)
    assert "does not fit this stage" in d.data.says[0]
    assert d.verdict != "clean"
    assert d.before_after[0] > 1.0
    with pytest.raises(BadInput, match="mrad"):
        diagnose_without_limits(given, replace(other, displacement_unit="mrad"))


def test_two_levels_give_no_loop_to_a_play_that_they_do_not_show() -> None:
    """Between two levels a square wave shows nothing: there the plain fit goes straight."""
    t = np.arange(4000) * DT
    u = np.where((np.arange(t.size) // 200) % 2 > 0, 8.0, 2.0) * (t > 0.2)
    noise = NOISE_UM * np.random.default_rng(2).standard_normal(t.size)
    data = prepare([Recording(t, u, maxwell_slip(np.random.default_rng(4))(u) + noise)])
    model = fit_plain_model(data, THRESHOLDS * data.span)
    assert np.all(model.hysteresis.b > -0.01 * model.hysteresis.b.sum())
    way = np.linspace(0.0, 8.0, 200)
    y = simulate(model, DT, np.concatenate([way, way[::-1]]))
    assert np.all(np.diff(y[:200]) > 0.0)
    assert np.abs(y[:200] - np.interp(way, [0.0, 8.0], y[[0, 199]])).max() < 0.1 * np.ptp(y)


def test_the_model_of_a_long_recording_is_identified_from_60_000_rows() -> None:
    """Four stretches of 15 000 rows: what lies between two of them has no influence."""
    n = 70_000
    t, rng = np.arange(n) * DT, np.random.default_rng(4)
    u = 5.0 + 4.6 * np.sin(2 * np.pi * 0.9 * t) * np.cos(2 * np.pi * 0.11 * t)
    y = plain(u) + NOISE_UM * rng.standard_normal(n)
    found = []
    for moved_um, at in ((0.0, slice(0, 0)), (3.0, slice(15_100, 18_300)), (3.0, slice(0, 3_200))):
        moved = y.copy()
        moved[at] += moved_um * np.sin(t[at])
        one = Recording(t, u, moved, name="long.csv")
        found.append(identify_plain_model([one], prepare([one])).model.hysteresis)
    whole, between, within = (np.concatenate([h.r, h.b, h.c]) for h in found)
    np.testing.assert_array_equal(between, whole)
    assert not np.array_equal(within, whole)
