"""An effect beside a model in use that is otherwise right, or that is of another class: the effect
has its own name and size, and the loop's shape gets what is left of the misfit, nothing more.
Stages are integrated here, by no equation of the library."""

import numpy as np
import pytest
from scipy.signal import lfilter, sawtooth
from tests.models.diagnosis.test_diagnosed_model import DT, NOISE_UM, N, drive, plain
from tests.models.diagnosis.test_names import bouc_wen
from tests.rigs.diagnosis import diagnose_without_limits

from dehyst.models.cascade.simulate import simulate
from dehyst.models.diagnosis import Diagnosis
from dehyst.models.diagnosis.base import rich_base
from dehyst.models.diagnosis.data.prepare import prepare
from dehyst.models.diagnosis.diagnosed_model import THRESHOLDS, DiagnosedModel, fit_plain_model
from dehyst.models.diagnosis.effects import Effect
from dehyst.models.diagnosis.evidence import blockwise_held_out_error
from dehyst.models.diagnosis.findings.shape import measure_correction
from dehyst.models.diagnosis.fit import Problem
from dehyst.models.diagnosis.shortlist import list_remaining
from dehyst.models.identify import identify
from dehyst.models.model import Model
from dehyst.models.physics import list_candidates
from dehyst.models.recording import Recording

T = np.arange(N) * DT
FINE = 20  # steps of the plant for each sample


def lag(x: np.ndarray, tau_s: float) -> np.ndarray:
    """Return a first-order lag of x, settled at its begin."""
    a = np.exp(-DT / tau_s)
    return x[0] + lfilter([1.0 - a], [1.0, -a], x - x[0])


def noisy(y: np.ndarray, seed: int) -> np.ndarray:
    return y + NOISE_UM * np.random.default_rng(seed).standard_normal(y.size)


def model_of(stage: object) -> Model:
    """Identify the model in use from two recordings without any effect."""
    given = [Recording(T, drive(k), noisy(stage(drive(k)), 90 + k)) for k in range(2)]  # type: ignore[operator]
    return identify(given).model


def names(d: Diagnosis) -> list[str]:
    return [f.name for f in d.findings]


def test_creep_added_to_a_stage_that_is_known_is_named_alone() -> None:
    """A base that is free to bend would take the first tenth of a second of creep for a shape."""
    given = []
    for k in range(2):
        x = plain(drive(k))
        relaxed = sum(0.01 * (lag(x, tau) - x[0]) for tau in np.geomspace(0.02, 40.0, 11))
        given.append(Recording(T, drive(k), noisy(x + relaxed, k), name=f"r{k}.csv"))
    d = diagnose_without_limits(given, model_of(plain))
    assert names(d) == ["creep"]
    gain = d.findings[0].parameters["gain_per_decade"]
    assert gain.low < 0.01 / np.log10(np.geomspace(0.02, 40.0, 11)[1] / 0.02) < gain.high
    assert d.verdict == "explained"
    assert d.rms["heldout_augmented"] < 1.15 * NOISE_UM


def test_a_zero_that_wanders_is_a_drift() -> None:
    """It is a function of time, another one in each recording: no loop, and nothing to write."""
    given = []
    for k in range(2):
        rng = np.random.default_rng(40 + k)
        walk = sum(
            0.15 / j * np.cos(np.pi * j * T / T[-1] + rng.uniform(0, 6.28)) for j in range(1, 5)
        )
        given.append(Recording(T, drive(k), noisy(plain(drive(k)) + walk, k), name=f"r{k}.csv"))
    in_use = model_of(plain)
    d = diagnose_without_limits(given, in_use)
    assert names(d) == ["drift"]
    assert d.verdict == "partly"
    assert "wanders" in d.findings[0].says
    assert d.model.blocks == in_use.blocks


@pytest.mark.parametrize("tau_s", [0.004, 0.012])
def test_coupling_through_a_lag(tau_s: float) -> None:
    """It is a coupling with that lag, neither a mode nor lines of hum."""
    given = []
    for k in range(2):
        other = 5 + 4 * sawtooth(2 * np.pi * (3.1 + k) * T, 0.5)
        y = plain(drive(k)) + 0.05 * lag(other, tau_s)
        given.append(
            Recording(T, drive(k), noisy(y, k), channels={"other_v": other}, name=f"r{k}.csv")
        )
    d = diagnose_without_limits(given, model_of(plain))
    assert names(d) == ["coupling"]
    found = d.findings[0].parameters
    assert found["gain_um_per_unit"].value == pytest.approx(0.05, rel=0.03)
    # the lag of the plant is exact for steps, that of the library for straight lines
    assert found["tau_s"].value == pytest.approx(tau_s - 0.5 * DT, abs=0.35 * DT)


def test_a_shape_beside_an_effect_gets_its_own_part_of_the_misfit() -> None:
    """The model in use leaves the loop's shape and the coupling, about as large: the shape has not
    removed more than the model in use left."""
    given = []
    for k in range(2):
        other = 5 + 4 * np.sin(2 * np.pi * (2.3 + k) * T)
        y = bouc_wen(drive(k)) + 0.03 * other
        given.append(
            Recording(T, drive(k), noisy(y, k), channels={"other_v": other}, name=f"r{k}.csv")
        )
    d = diagnose_without_limits(given, model_of(bouc_wen))
    by = {f.name: f for f in d.findings}
    assert {"shape", "coupling"} <= by.keys()
    assert by["shape"].evidence["removed_rms"] < d.rms["heldout_model"]
    coupled = 0.03 * 4 / np.sqrt(2)
    share = coupled**2 / (d.rms["heldout_model"] ** 2 - d.noise**2)
    assert by["coupling"].share == pytest.approx(share, abs=0.15)


@pytest.mark.parametrize("carries", [True, False])
def test_a_shape_removes_what_the_model_in_use_leaves_and_no_more(carries: bool) -> None:
    """Also where the base stands in for the given model. What is left out leaves the noise: the
    rest of the model's error, simulated here, is the shape's."""
    given = [Recording(T, drive(k), noisy(bouc_wen(drive(k)), k), name=f"r{k}") for k in range(2)]
    data = prepare(given)
    model = fit_plain_model(data, THRESHOLDS * data.span)
    problem = Problem(data, rich_base(data), DiagnosedModel(model, given=True, carries=carries))
    final = problem.solve([])
    held = blockwise_held_out_error(problem, final)
    errors = [one.displacement - simulate(model, DT, one.drive) for one in given]
    left = float(np.mean([np.var(e) for e in errors]))
    assert held < 1.1 * NOISE_UM**2 < 0.5 * left
    correction = measure_correction(problem, final, np.nan, held)
    assert correction.gain == pytest.approx(left - held, rel=0.02)


def test_an_effect_is_tried_in_one_form_at_a_time() -> None:
    """With the simple form in the fit, its finer forms replace it and are not added to it; with a
    finer form, the simple one is not. The other channel's coupling is another effect."""
    channels = {
        name: 5 + 4 * sawtooth(2 * np.pi * f * T, 0.5) for name, f in (("u2_v", 3.1), ("u3_v", 4.3))
    }
    data = prepare([Recording(T, drive(0), noisy(plain(drive(0)), 0), channels=channels)])
    problem, everything = Problem(data, rich_base(data)), list_candidates(data)
    by_key = {c.key: c for c in everything}

    def remaining(*there: Effect) -> set[str]:
        return {c.key for c in list_remaining(problem, problem.solve(there), everything)}

    forms = {"coupling-u2_v", "coupledlag-u2_v", "coupling2-u2_v"}
    others = {"coupling-u3_v", "coupledlag-u3_v"}
    drifts = {"drift-trend", "drift-wander"}
    assert remaining() >= {"coupling-u2_v", "coupledlag-u2_v", *others, *drifts}
    for key, theta in (("coupling-u2_v", ()), ("coupledlag-u2_v", (0.01,))):
        left = remaining(Effect(by_key[key], theta))
        assert left >= others | drifts
        assert not left & forms
    for key, theta in (("drift-trend", (1.0,)), ("drift-wander", ())):
        assert not remaining(Effect(by_key[key], theta)) & drifts


def test_nothing_is_explained_by_a_shape_that_is_not_written() -> None:
    """Loops of one size do not show what others are like, so no model of their shape is written;
    little more than the noise is left of the recordings all the same."""
    u = 5 + 3 * np.sin(2 * np.pi * T) + 1.5 * np.sin(4 * np.pi * T)
    given = []
    for k in range(2):
        other = 5 + 4 * np.sin(2 * np.pi * (2.3 + k) * T)
        y = plain(u) + 1.8 * NOISE_UM * ((u - 5) / 4.5) ** 3 + 0.006 * other
        given.append(Recording(T, u, noisy(y, k), channels={"other_v": other}, name=f"r{k}.csv"))
    d = diagnose_without_limits(given, model_of(plain))
    by = {f.name: f for f in d.findings}
    assert {"shape", "coupling"} <= by.keys()
    assert by["shape"].share > 0.12
    assert "does not contain it" in by["shape"].says
    assert d.rms["heldout_augmented"] < 1.4 * d.noise
    assert d.verdict == "partly"


def test_a_drive_held_after_its_row_is_a_sample_late() -> None:
    """The recorder writes a command with the reading of the moment before it: a mode is one sample
    late, which no lag is."""
    n, h = FINE, DT / FINE
    w, z = 2 * np.pi * 60.0, 0.03
    wd = w * np.sqrt(1.0 - z**2)
    pole = np.exp((-z * w + 1j * wd) * h)
    a = [1.0, -2.0 * pole.real, abs(pole) ** 2]
    given = []
    for k in range(2):
        u = drive(k) if k else np.repeat(np.random.default_rng(3).uniform(1, 9, N // 200), 200)
        x = np.repeat(plain(u), n)
        y = x[0] + lfilter([0.0, sum(a)], a, x - x[0])
        given.append(Recording(T, u, noisy(y[::n], k), name=f"r{k}.csv"))
    d = diagnose_without_limits(given, model_of(plain))
    assert names(d)[0] == "resonance"
    assert set(names(d)) <= {"resonance", "delay"}
    (late,) = [f for f in d.findings if f.name == "delay"]
    assert late.parameters["delay_s"].value == pytest.approx(DT, rel=0.03)
