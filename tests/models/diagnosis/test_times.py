"""Effects with a time: creep from before the recording, a line for a part of it, a slip; lines of
the drive that are not ambient; recordings that are too long to be fitted whole."""

from dataclasses import replace

import numpy as np
import pytest
from tests.models.diagnosis.test_diagnosed_model import DT, NOISE_UM, drive, plain, recordings
from tests.rigs.diagnosis import diagnose_without_limits

from dehyst.models.diagnosis import diagnose
from dehyst.models.diagnosis.base import rich_base
from dehyst.models.diagnosis.data.excerpt import excerpt
from dehyst.models.diagnosis.data.prepare import prepare
from dehyst.models.diagnosis.findings.episodes import (
    describe_residual_change,
    find_episodes,
)
from dehyst.models.recording import Recording
from dehyst.models.signals.lines import find_lines


def changed(add: object) -> list[Recording]:
    """Return the plain stage's recordings with add(t, number) added to the reading."""
    return [
        Recording(r.t_s, r.drive, r.displacement + add(r.t_s, k), name=r.name)  # type: ignore[operator]
        for k, r in enumerate(recordings(plain))
    ]


def test_creep_of_an_earlier_move_is_named_as_creep() -> None:
    """The recording begins a second after a move of 10 um: creep of 1.2 % of it per decade, by
    Kelvin-Voigt elements (four relaxations of 0.3 to 30 s)."""

    def past(t: np.ndarray, k: int) -> np.ndarray:
        taus = np.array([0.3, 1.4, 6.5, 30.0])
        size = 0.12 * (1 - 2 * k) / 1.5
        return sum(size * np.exp(-1.0 / tau) * (1 - np.exp(-t / tau)) for tau in taus)

    d = diagnose_without_limits(changed(past))
    first = d.findings[0]
    assert first.name == "creep"
    assert "before the recording" in first.says
    # the two moves were in opposite directions: no model predicts the next recording's
    assert d.verdict == "partly"
    assert "The written model does not contain it" in first.says
    assert d.rms["augmented"] == d.rms["model"]


def test_hum_for_a_third_of_the_time_is_named_with_its_time() -> None:
    def hum(t: np.ndarray, k: int) -> np.ndarray:
        return 0.04 * np.sin(2 * np.pi * 57.3 * t) * ((t > 3.0) & (t < 5.7)) * (k == 0)

    d = diagnose(changed(hum))
    named = {f.name: f for f in d.findings}
    assert "hum" in named
    where = named["hum"].where
    assert where["recording"] == "r0.csv"
    assert where["from_s"] == pytest.approx(3.0, abs=0.4)
    assert where["to_s"] == pytest.approx(5.7, abs=0.4)
    assert named["hum"].parameters["frequency_hz"].value == pytest.approx(57.3, abs=0.2)
    assert {x.name for x in d.would_have_seen}.isdisjoint({"hum"})


def test_a_line_for_a_time_in_several_recordings_is_said_of_all_of_them() -> None:
    data = prepare(recordings(plain))
    noise = NOISE_UM * np.random.default_rng(4).standard_normal(data.n)
    there = (data.t > 3.0) & (data.t < 5.7) & (data.rec < 2)
    found = find_episodes(data, noise + 0.08 * there * np.sin(2 * np.pi * 57.3 * data.t), NOISE_UM)
    assert found is not None
    said = found.finding.says.partition(" the reading contains ")[0]
    assert said.startswith("From ")
    assert " s of r0.csv" in said
    assert " s of r1.csv" in said


def test_a_line_that_began_and_goes_on_through_the_next_recording_is_one_finding() -> None:
    """What does not count, as before the drive's past is known, does not change its values."""
    data = prepare(recordings(plain))
    head = (data.rec == 1) & (data.t < 0.3)
    data = replace(data, rows=data.rows & ~head)
    residual = NOISE_UM * np.random.default_rng(4).standard_normal(data.n)
    residual = residual + head * 3.0 * np.cos(2 * np.pi * 20.0 * data.t)
    line = 0.08 * np.sin(2 * np.pi * 57.3 * data.t + data.rec)
    begun = (data.rec == 1) | (data.t > 3.0)
    found = find_episodes(data, residual + begun * line, NOISE_UM)
    assert found is not None
    assert found.finding.says.startswith("From 3 s of r0.csv on the reading contains ")
    assert found.finding.where["recording"] == "r0.csv"
    assert found.finding.where["from_s"] == pytest.approx(3.0, abs=0.4)
    assert "to_s" not in found.finding.where
    values = found.finding.parameters
    assert values["frequency_hz"].value == pytest.approx(57.3, abs=0.005)
    assert values["amplitude_um"].value == pytest.approx(0.08, rel=0.03)
    assert np.std((begun * line - found.removed)[data.rows]) < 0.1 * 0.08
    weak = np.where(data.rec == 1, 0.2, data.t > 3.0)  # another one, at the same frequency
    other = find_episodes(data, residual + weak * line, NOISE_UM)
    assert other is not None
    assert "r1.csv" not in other.finding.says


def test_a_line_is_found_in_its_stretches_only() -> None:
    data = prepare(recordings(plain))
    rng = np.random.default_rng(2)
    noise = NOISE_UM * rng.standard_normal(data.n)
    assert find_episodes(data, noise, NOISE_UM) is None
    always = noise + 0.03 * np.sin(2 * np.pi * 57.3 * data.t)
    assert find_episodes(data, always, NOISE_UM) is None
    some = noise + 0.03 * np.sin(2 * np.pi * 57.3 * data.t) * (data.t < 2.0) * (data.rec == 1)
    episode = find_episodes(data, some, NOISE_UM)
    assert episode is not None
    assert episode.finding.where["to_s"] == pytest.approx(2.0, abs=0.4)
    assert np.std(some - episode.removed) < 1.05 * NOISE_UM


def test_a_harmonic_of_a_drive_that_swells_is_no_line_of_a_part_of_the_time() -> None:
    """A slew limit clips a fast sine at high amplitude, and generates its third harmonic there."""
    t = np.arange(9000) * DT
    swells = np.exp(-(((t - 4.0) / 1.2) ** 2))
    u = 5 + 2.5 * np.sin(2 * np.pi * 0.46 * t) + (0.1 + swells) * np.sin(2 * np.pi * 21.7 * t)
    noise = NOISE_UM * np.random.default_rng(5).standard_normal(t.size)
    data = prepare([Recording(t, u, u + noise)])
    loud = swells > 0.5
    third = 0.05 * loud * np.sin(2 * np.pi * 65.1 * t)
    assert find_episodes(data, noise + third, NOISE_UM) is None
    beside = find_episodes(data, noise + 0.05 * loud * np.sin(2 * np.pi * 57.3 * t), NOISE_UM)
    assert beside is not None
    assert beside.finding.parameters["frequency_hz"].value == pytest.approx(57.3, abs=0.3)


def test_the_time_of_a_slip_and_of_a_change_is_reported() -> None:
    data = prepare(recordings(plain))
    noise = NOISE_UM * np.random.default_rng(3).standard_normal(data.n)
    text, places = describe_residual_change(
        data, noise + 0.1 * ((data.t > 4.2) & (data.rec == 0)), NOISE_UM
    )
    assert "shifts" in text
    assert places["from_s"] == pytest.approx(4.2, abs=0.05)
    late = noise * np.where((data.t > 5.0) & (data.rec == 1), 6.0, 1.0)
    text, places = describe_residual_change(data, late, NOISE_UM)
    assert "from" in text
    assert places["from_s"] == pytest.approx(5.0, abs=0.1)
    assert describe_residual_change(data, noise, NOISE_UM) == ("", {})


@pytest.mark.parametrize("f", [0.5, 1.0, 2.0])
@pytest.mark.parametrize("form", ["sine", "triangle"])
def test_a_periodic_drive_makes_no_lines_of_the_surroundings(f: float, form: str) -> None:
    """The residual of a hysteresis of another class repeats with the drive."""
    t = np.arange(12_000) * DT
    phase = f * t % 1.0
    u = 5 - 4.5 * np.cos(2 * np.pi * phase) if form == "sine" else 9 * (1 - np.abs(2 * phase - 1))
    ahead = np.maximum(u - np.roll(u, 37), 0.0)  # turns sharply twice a period
    noise = 0.002 * np.random.default_rng(1).standard_normal(t.size)
    data = prepare([Recording(t, u, plain(u) + noise)])
    residual = 0.02 * np.tanh(3 * ahead) * np.sin(2 * np.pi * phase) ** 2 + noise
    assert find_lines(data, residual - residual.mean()) == []


def test_products_of_two_lines_of_the_drive_are_blind() -> None:
    t = np.arange(12_000) * DT
    u = 5 + 2.5 * np.sin(2 * np.pi * 3.13 * t) + 2 * np.sin(2 * np.pi * 11.71 * t + 1)
    noise = 0.002 * np.random.default_rng(1).standard_normal(t.size)
    data = prepare([Recording(t, u, u + noise)])
    product = 0.01 * np.sin(2 * np.pi * (11.71 + 3.13) * t) + 0.01 * np.sin(
        2 * np.pi * (2 * 11.71 - 3.13) * t
    )
    assert find_lines(data, noise + product) == []
    beside = 0.01 * np.sin(2 * np.pi * 47.9 * t)
    assert find_lines(data, noise + product + beside) == [pytest.approx(47.9, abs=0.05)]


def test_a_line_is_found_among_the_harmonics_of_a_common_period() -> None:
    """Two sines repeat together about every ten seconds: harmonics of that lie everywhere."""
    t = np.arange(6000) * 0.01
    u = 5 + 2.5 * np.sin(2 * np.pi * 5.0 * t) + 2 * np.sin(2 * np.pi * 8.1 * t + 1)
    noise = 0.002 * np.random.default_rng(1).standard_normal(t.size)
    data = prepare([Recording(t, u, u + noise)])
    line = 0.01 * np.sin(2 * np.pi * 12.2 * t)  # the 122nd
    assert find_lines(data, noise + line) == [pytest.approx(12.2, abs=0.005)]


def test_a_line_of_the_reading_is_found_though_feedback_brings_it_into_the_drive() -> None:
    """An integrating loop drives against hum of the sensor."""
    t = np.arange(12_000) * DT
    hum = 0.01 * np.sin(2 * np.pi * 47.9 * t)
    u = 5 + 2.5 * np.sin(2 * np.pi * 0.31 * t) - 0.6 * hum
    noise = 0.002 * np.random.default_rng(1).standard_normal(t.size)
    data = prepare([Recording(t, u, u + hum + noise)])
    assert find_lines(data, hum + noise) == [pytest.approx(47.9, abs=0.05)]


def test_a_line_is_found_in_stretches_that_lie_apart() -> None:
    t = np.arange(100_000) * DT
    u = 5 + 2.5 * np.sin(2 * np.pi * 0.413 * t) + np.sin(2 * np.pi * 2.27 * t)
    noise = 0.01 * np.random.default_rng(1).standard_normal(t.size)
    part = excerpt(prepare([Recording(t, u, u + noise)]), 24_000)
    line = 0.01 * np.sin(2 * np.pi * 50.013 * part.t)
    e = line + 0.01 * np.random.default_rng(2).standard_normal(part.n)
    assert find_lines(part, e) == [pytest.approx(50.013, abs=0.002)]


def test_an_excerpt_keeps_the_memory_of_the_drive() -> None:
    """The base's columns at the samples of an excerpt are those of the whole recording: exactly for
    the plays whose state the intermediate extremes preserve, nearly for the others."""
    t = np.arange(60_000) * DT
    u = np.concatenate([drive(k) for k in (0, 1) * 4])[: t.size]
    data = prepare([Recording(t, u, u + 0.01 * np.random.default_rng(0).standard_normal(t.size))])
    part = excerpt(data, 12_000)
    assert 8_000 < part.n < 20_000
    base = rich_base(data)
    whole = base.columns(data.u, data.forgets)[part.raw_index]
    own = base.columns(part.u, part.forgets)
    np.testing.assert_allclose(own[part.rows], whole[part.rows], atol=0.02)
    assert np.all(np.diff(part.t) > 0)
    assert not np.any((part.rows & part.starts)[1:])
    assert excerpt(data, 100_000) is data
