"""Recordings that carry little information, or resolve more than any model: slow sampling, little
noise, a single waveform. What is reported of them is true, or nothing is reported; a reported limit
holds if the effect is put in by another equation and the diagnosis is repeated."""

from functools import cache

import numpy as np
import pytest
from scipy.signal import lfilter
from tests.models.diagnosis.test_diagnosed_model import DT, NOISE_UM, N, drive, plain, recordings
from tests.models.diagnosis.test_names import bouc_wen
from tests.rigs.diagnosis import diagnose_without_limits

from dehyst.models.cascade.simulate import simulate
from dehyst.models.diagnosis import Diagnosis, Limit, diagnose
from dehyst.models.recording import Recording


def check_rules(d: Diagnosis) -> None:
    """Check what holds for every answer: shares sum to at most one, intervals span at most a factor
    of ten, nothing predicts worse than the model in use."""
    said = d.to_dict()
    assert sum(e["share"] for e in said["effects"]) <= 1.0 + 1e-9
    for effect in said["effects"]:
        assert effect["acts_on"] in ("stage", "drive", "sensor")
        for key, one in effect["parameters"].items():
            if one["low"] * one["high"] > 0:
                low, high = sorted((abs(one["low"]), abs(one["high"])))
                assert high <= 10.0 * low, (effect["name"], key, one)
    assert said["rms"]["heldout_augmented"] <= said["rms"]["heldout_model"] + d.noise
    if d.verdict in ("unknown", "partly"):
        assert said["would_have_seen"] == []
    ties = {n for e in said["effects"] for n in (e["name"], *e["ambiguous_with"])}
    assert ties.isdisjoint(x["name"] for x in said["would_have_seen"])


def two_sines(late_s: float, seed: int) -> Recording:
    """Return 4 and 8.7 Hz for 40 s, read at 50 Hz; the stage is integrated at 1 kHz."""
    rng, t = np.random.default_rng(seed), np.arange(40_000) * DT
    f = rng.uniform(0.8, 1.2)
    u = 5 - 2.3 * np.cos(2 * np.pi * 4 * f * t) - 2.3 * np.cos(2 * np.pi * 8.7 * f * t)
    u *= np.clip(t, 0, 1)
    y = plain(np.interp(t - late_s, t, u)) + NOISE_UM * rng.standard_normal(t.size)
    return Recording(t[::20], u[::20], y[::20], name=f"s{seed}.csv")


@pytest.mark.parametrize("late_s", [0.0, 0.03])
def test_slow_sampling_of_a_stage_with_and_without_a_delay(late_s: float) -> None:
    # limits are reported if nothing was found
    ask = diagnose_without_limits if late_s else diagnose
    d = ask([two_sines(late_s, 1), two_sines(late_s, 2)])
    check_rules(d)
    assert any("sampling is slow" in said for said in d.data.says)
    named = [f.name for f in d.findings if f.name not in ("shape", "unknown")]
    if late_s:
        assert {"delay", "lag"} & {n for f in d.findings for n in (f.name, *f.ambiguous_with)}
        assert d.verdict != "clean"
        assert set(named) <= {"delay", "lag"}
    else:
        assert named == []


def test_a_delay_at_few_moments_of_the_drive_is_not_said_to_explain() -> None:
    """Two frequencies that are parts of the sampling rate: ten moments are read again and again,
    and rows left out repeat those that were fitted."""
    given = []
    for seed in (1, 2):
        t = np.arange(40_000) * DT
        u = 5.0 + (3.0 - 0.5 * seed) * np.sin(2 * np.pi * 5.0 * t)
        u += (1.0 + 0.3 * seed) * np.sin(2 * np.pi * 10.0 * t + 1.0)
        y = plain(np.interp(t - 0.0185, t, u))
        y += 2.0 * NOISE_UM * np.random.default_rng(seed).standard_normal(t.size)
        given.append(Recording(t[::20], u[::20], y[::20], name=f"s{seed}.csv"))
    d = diagnose_without_limits(given)
    assert [f.name for f in d.findings] == ["delay"]
    assert d.rms["heldout_augmented"] < 1.2 * d.noise
    assert d.verdict == "partly"


@pytest.mark.parametrize("stage", [plain, bouc_wen], ids=["in the class", "foreign"])
def test_with_little_noise_what_the_base_leaves_is_no_physics(stage: object) -> None:
    """The noise is 1e-4 of the stroke: the base's own misfit exceeds it."""
    given = []
    for k in range(2):
        u = drive(k)
        y = stage(u) + 1e-3 * np.random.default_rng(k).standard_normal(N)  # type: ignore[operator]
        given.append(Recording(np.arange(N) * DT, u, y, name=f"q{k}.csv"))
    # limits are reported for the first stage only; the other one's are tested with more noise
    d = diagnose(given) if stage is plain else diagnose_without_limits(given)
    check_rules(d)
    assert {f.name for f in d.findings} <= {"shape", "unknown"}


def test_one_waveform_gives_no_model_that_is_worse_on_another() -> None:
    t = np.arange(N) * DT
    u = 5 - 4.5 * np.cos(2 * np.pi * 1.3 * t)
    noise = NOISE_UM * np.random.default_rng(4).standard_normal(N)
    d = diagnose_without_limits([Recording(t, u, bouc_wen(u) + noise)])
    check_rules(d)
    assert {f.name for f in d.findings} <= {"shape", "unknown"}
    other = drive(1)
    errors = [np.std(bouc_wen(other) - simulate(m, t, other)) for m in (d.base_model, d.model)]
    assert errors[1] <= errors[0] + NOISE_UM


@cache
def told_limits() -> dict[str, Limit]:
    """Return the limits of a stage of the model's own class."""
    return {x.name: x for x in diagnose(recordings(plain)).would_have_seen}


@pytest.mark.parametrize("name", ["hum", "delay"])
def test_a_limit_holds_when_the_effect_is_put_in(name: str) -> None:
    """A line of another phase than the probe's; a delay of the drive itself."""
    limit = told_limits()[name]
    assert limit.value is not None
    if name == "delay":
        given = recordings(plain, late_s=limit.value)
    else:
        given = [
            Recording(
                r.t_s,
                r.drive,
                r.displacement + limit.value * np.sin(2 * np.pi * 50.0 * r.t_s + 1.0),  # type: ignore[operator]
                name=r.name,
            )
            for r in recordings(plain)
        ]
    d = diagnose_without_limits(given)
    assert name in {n for f in d.findings for n in (f.name, *f.ambiguous_with)}


def test_a_line_on_a_harmonic_of_one_loop_is_no_resonance() -> None:
    """60 Hz in the reading of a 1 Hz triangle: its origin cannot be determined, and no mode is
    reported in its place."""
    t = np.arange(12_000) * DT
    u = 8.0 * (1.0 - np.abs(2.0 * np.mod(t, 1.0) - 1.0))
    hum = 0.15 * np.sin(2 * np.pi * 59.986 * t + 0.7)
    noise = NOISE_UM * np.random.default_rng(6).standard_normal(t.size)
    d = diagnose_without_limits([Recording(t, u, plain(u) + hum + noise, name="one.csv")])
    check_rules(d)
    assert "unknown" in {f.name for f in d.findings}
    assert not {"resonance", "delay", "lag"} & {f.name for f in d.findings}


def test_a_slew_limit_that_few_moves_meet_is_found() -> None:
    """A tenth of a second of steps, limited to a third of their speed; the search starts nearby."""
    rng = np.random.default_rng(8)
    t = np.arange(8000) * DT
    levels = np.r_[0.0, rng.uniform(0.5, 9.5, 9)]
    u = lfilter([0.5], [1.0, -0.5], levels[np.minimum((t / 0.8).astype(int), 9)])
    smooth = drive(0)[: t.size]
    given = []
    for k, one in enumerate((u, smooth)):
        v = np.empty(one.size)
        v[0] = one[0]
        for i in range(1, v.size):
            v[i] = v[i - 1] + np.clip(one[i] - v[i - 1], -0.9, 0.9)
        y = plain(v) + NOISE_UM * np.random.default_rng(k).standard_normal(t.size)
        given.append(Recording(t, one, y, name=f"m{k}.csv"))
    d = diagnose_without_limits(given)
    assert d.findings[0].name == "slew"
    value = d.findings[0].parameters["rate_v_per_s"]
    assert value.low < 900.0 < value.high
