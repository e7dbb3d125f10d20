"""Recordings of one stage may begin anywhere and differ in size: each keeps its own start."""

import itertools
from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest
from scipy import signal
from tests.rigs.diagnosis import diagnose_without_limits
from tests.rigs.outside import plays

from dehyst.models.identify import identify
from dehyst.models.identify.data.outliers import remove_glitches
from dehyst.models.identify.validation import validate
from dehyst.models.recording import Floats, Recording

RATE_HZ, NOISE_UM = 500.0, 0.008
R = np.linspace(0.0, 60.0, 25)
W = 0.1 * np.exp(-R / 12.0) / np.exp(-R / 12.0).sum() + 0.0004


def times(seconds: float) -> Floats:
    return np.arange(round(seconds * RATE_HZ)) / RATE_HZ


def record(name: str, u: Floats, before: Floats, seed: int) -> Recording:
    """Record a drive after another one, which is not in the file."""
    y = plays(np.r_[before, u], R, W)[before.size :]
    noise = NOISE_UM * np.random.default_rng(seed).standard_normal(u.size)
    return Recording(times(u.size / RATE_HZ), u, y + noise, name=f"{name}.csv")


def sine(low: float, high: float, hz: float, seconds: float, start: float = 0.0) -> Floats:
    x = hz * times(seconds) + start
    return np.asarray(low + (high - low) * 0.5 * (1.0 - np.cos(2 * np.pi * x)))


REST = np.zeros(1)
EXERCISED = np.r_[np.linspace(0, 140, 80), np.linspace(140, 0, 80), np.linspace(0, 39, 30)]
FULL = record("full", sine(0.0, 150.0, 0.7, 6.0), REST, 1)
SECOND = {
    "a part, exercised before": record("second", sine(39.0, 70.0, 1.3, 5.0), EXERCISED, 2),
    "most, begins in the middle": record(
        "second", sine(20.0, 140.0, 1.1, 5.0, 0.25), np.r_[EXERCISED, 80.0], 3
    ),
    "a part, from rest": record("second", sine(0.0, 60.0, 1.9, 4.0), REST, 4),
}


@pytest.mark.parametrize("second", SECOND)
@pytest.mark.parametrize("first", [True, False])
def test_a_second_recording_of_another_size_and_start_is_used(second: str, first: bool) -> None:
    pair = [FULL, SECOND[second]] if first else [SECOND[second], FULL]
    found = identify(pair)
    for one, used in zip(found.recordings, found.used, strict=True):
        assert one.rms < 1.3 * NOISE_UM
        assert np.mean(used) > 0.6


def clean_set() -> list[Recording]:
    """A sweep from rest, a multisine that begins in the middle, and ramps that end in rests, of
    which a straight line leaves as little as a model."""
    t = times(8.0)
    sweep = 65.0 * (1.0 - np.cos(2 * np.pi * (0.4 + 0.35 * t) * t))
    several = sum(np.sin(2 * np.pi * f * t + f) for f in (0.7, 2.3, 5.1, 11.0))
    several = 72.0 + 16.0 * np.asarray(several)
    levels = np.repeat([0.0, 30.0, 90.0, 10.0, 120.0, 60.0, 20.0, 110.0], 500)
    ramps = levels.copy()
    for at in range(500, ramps.size, 500):
        ramps[at : at + 250] = np.linspace(levels[at - 1], levels[at], 250)
    before = np.r_[EXERCISED, np.linspace(39.0, several[0], 40)]
    return [
        record("sweep", sweep, REST, 5),
        record("multisine", several, before, 6),
        record("ramps", ramps, REST, 7),
    ]


def test_a_clean_stage_is_clean_with_a_recording_that_begins_anywhere() -> None:
    given = clean_set()
    assert identify(given).model.fit.rms < 1.2 * NOISE_UM
    found = diagnose_without_limits(given)
    assert (found.verdict, found.findings) == ("clean", ())


def test_lone_readings_are_left_out_and_said() -> None:
    given = clean_set()
    y = given[0].displacement.copy()  # type: ignore[union-attr]
    y[[400, 1500, 2600]] += 1.0
    given[0] = replace(given[0], displacement=y)
    found = diagnose_without_limits(given)
    assert (found.verdict, found.findings) == ("clean", ())
    assert any(said.startswith("3 isolated readings") for said in found.data.says)


@pytest.mark.parametrize("seed", range(3))
def test_no_noise_is_lone(seed: int) -> None:
    """The deviation of white noise from the median of five has a median of half a standard
    deviation, and exceeds 4.4 standard deviations in one row of 20 000."""
    sweep = record("sweep", sine(0.0, 150.0, 1.2, 20.0), REST, seed)
    noise = 0.03 * np.random.default_rng(seed).standard_normal(sweep.size)
    found = identify([replace(sweep, displacement=np.add(sweep.displacement, noise))])
    assert not any("isolated" in note for note in found.notes)


def follow_late(name: str, u: Floats, tau_s: float, seed: int) -> Recording:
    """Record a stage behind a first-order lag, whose drive is held between the samples: the lag's
    exact response."""
    still, left = plays(u, R, W), np.exp(-1.0 / (RATE_HZ * tau_s))
    y = np.empty(u.size)
    y[0] = still[0]
    for k in range(1, u.size):
        y[k] = left * y[k - 1] + (1.0 - left) * still[k - 1]
    noise = NOISE_UM * np.random.default_rng(seed).standard_normal(u.size)
    return Recording(times(u.size / RATE_HZ), u, y + noise, name=f"{name}.csv")


def test_the_peaks_of_a_mode_that_rings_are_not_lone() -> None:
    levels = np.random.default_rng(4).uniform(0.0, 150.0, 30)
    u, w = np.repeat(np.r_[0.0, levels], 150), 2 * np.pi * 35.0
    still = plays(u, R, W)
    _, y, _ = signal.lsim(([w**2], [1.0, 0.1 * w, w**2]), still, times(u.size / RATE_HZ))
    y += NOISE_UM * np.random.default_rng(6).standard_normal(u.size)
    found = identify([Recording(times(u.size / RATE_HZ), u, y, name="stairs.csv")])
    assert not any("isolated" in note for note in found.notes)


@pytest.mark.parametrize("tau_s", [0.002, 0.005, 0.02])
def test_readings_after_an_edge_that_the_stage_follows_late_are_not_lone(tau_s: float) -> None:
    rng = np.random.default_rng(3)
    levels = np.r_[0.0, 150.0, 30.0, 120.0, 60.0, 90.0, rng.uniform(0.0, 150.0, 24)]
    found = identify([follow_late("stairs", np.repeat(levels, 150), tau_s, 5)])
    assert not any("isolated" in note for note in found.notes)
    assert found.used[0].all()
    others = np.repeat(rng.uniform(0.0, 150.0, 24), 100), sine(0.0, 150.0, 1.5, 6.0)
    for seed, u in enumerate(others):
        assert not validate(found.model, follow_late("other", u, tau_s, seed)).worse


def test_a_recording_that_sweeps_its_range_only_before_a_rest_is_not_of_another_stage() -> None:
    ways = np.r_[np.linspace(39.0, 10.0, 300), np.linspace(10.0, 120.0, 300), np.full(1500, 120.0)]
    found = identify([FULL, record("rest", ways, EXERCISED, 8)])
    assert found.recordings[1].rms < 1.5 * NOISE_UM


@pytest.mark.parametrize("begin_s", [0.0, 1e5])
def test_exact_times_do_not_jitter(begin_s: float) -> None:
    t = begin_s + times(6.0)
    u = np.abs((np.arange(t.size) % 800) - 400.0) / 4.0
    y = plays(np.r_[np.linspace(0.0, u[0], 50), u], R, W)[50:]
    y = y + NOISE_UM * np.random.default_rng(6).standard_normal(u.size)
    found = identify([Recording(t, u, y, name="triangle.csv")])
    assert not any("jitter" in note for note in found.notes)


def of_another_gain(one: Recording) -> Floats:
    assert one.displacement is not None
    return np.asarray(1.15 * one.displacement)


def of_a_gauge_that_is_off(one: Recording) -> Floats:
    return 3.0 + NOISE_UM * np.random.default_rng(9).standard_normal(one.size)


@pytest.mark.parametrize("which", [0, 2])
@pytest.mark.parametrize("fault", [of_another_gain, of_a_gauge_that_is_off])
def test_a_recording_that_does_not_belong_is_named_and_the_others_are_used(
    which: int, fault: Callable[[Recording], Floats]
) -> None:
    given = [*clean_set(), FULL]
    odd = given[which] = replace(given[which], displacement=fault(given[which]))
    found = diagnose_without_limits(given)
    assert (found.verdict, found.findings) == ("clean", ())
    assert found.data.says[0].startswith(f"the recording {odd.name} does not match the others")
    assert odd.name not in found.rms["model"]


def with_hum(one: Recording, phase: float) -> Recording:
    assert one.displacement is not None
    hum = 0.03 * np.sin(2 * np.pi * 50.0 * one.t_s + phase)
    return replace(one, displacement=one.displacement + hum)


def test_hum_in_the_others_does_not_keep_a_recording_that_does_not_belong() -> None:
    """Hum is named and left in the readings: the verdict on the others is `partly`."""
    given = [with_hum(one, 2.0 * i) for i, one in enumerate([*clean_set(), FULL])]
    given[2] = replace(given[2], displacement=of_another_gain(given[2]))
    found = diagnose_without_limits(given)
    assert [finding.name for finding in found.findings] == ["hum"]
    assert "does not match the others" in found.data.says[0]


def test_no_drive_beside_a_pause_is_a_glitch() -> None:
    t_s = 1e-3 * np.arange(2400)
    notes: list[str] = []
    for first, rows in itertools.product(range(100, 1700, 37), (50, 120, 333, 600)):
        u = 50.0 + 50.0 * np.sin(2.0 * np.pi * 5.0 * t_s)
        kept = np.delete(np.arange(t_s.size), slice(first, first + rows))
        found = remove_glitches("pause.csv", t_s[kept], u[kept], notes)
        np.testing.assert_array_equal(found, u[kept])
    assert notes == []


@pytest.mark.parametrize("lost", [True, False])
def test_what_changes_across_a_pause_is_no_glitch_and_what_follows_is_not_bridged(
    lost: bool,
) -> None:
    """An early pause, in which the drive goes on: the rows after it depend on an unknown past."""
    u = sine(0.0, 100.0, 0.7, 8.0) * np.linspace(1.0, 0.3, 4000)
    one = record("pause", u, REST, 10)
    assert one.displacement is not None
    keep = np.ones(u.size, dtype=bool)
    keep[900:1500] = False
    if lost:
        given = Recording(one.t_s[keep], u[keep], one.displacement[keep], name="pause.csv")
    else:
        hole = np.where(keep, 1.0, np.nan)
        given = Recording(one.t_s, u * hole, one.displacement * hole, name="pause.csv")
    found = identify([given])
    assert not any("isolated drive outliers" in note for note in found.notes)
    assert found.recordings[0].rms < 1.3 * NOISE_UM
    assert any("left out" in note and "(start, steps, gaps" in note for note in found.notes)
