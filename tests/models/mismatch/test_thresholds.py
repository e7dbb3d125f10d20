"""The monitor's thresholds with explicit figures, compared with scipy's Gumbel distribution; the
stage is its model plus white noise, at 20 samples a second."""

import copy

import numpy as np
import pytest
from scipy.stats import gumbel_r

from dehyst.models.mismatch.monitor import MismatchMonitor
from dehyst.models.model import Fit, Hysteresis, Model, Validity

RATE = 20
NOISE_UM = 0.02
MODEL = Model(
    Hysteresis(r=[0.0], b=[0.1], c=[0.0, 1.0]),
    Validity(0.0, 100.0),
    fit=Fit(NOISE_UM, NOISE_UM, NOISE_UM),
)
LEAST = {"gain": 0.7, "offset": 2.1, "whole": 1.6, "all": 2.5, "ringing": 1.6, "short": 1.9}


class Watched:
    """A monitor that is fed second by second; seconds: (figures, thresholds, mismatch) of each."""

    def __init__(self, seed: int = 0) -> None:
        self.monitor = MismatchMonitor(MODEL, 1 / RATE)
        self.rng = np.random.default_rng(seed)
        self.now = 0

    def feed(
        self,
        seconds: float,
        extra_um: np.ndarray | float = 0.0,
        swing: float = 0.4,
        hz: float = 0.23,
    ) -> list[tuple[dict[str, float], dict[str, float], bool]]:
        """extra_um: added to the reading; swing: amplitude of the drive in ranges, at hz."""
        count = round(seconds * RATE)
        t = (self.now + np.arange(count)) / RATE
        self.now += count
        drive = 50.0 + 100.0 * swing * np.sin(2 * np.pi * hz * t)
        reading = 0.1 * drive + NOISE_UM * self.rng.standard_normal(count) + extra_um
        out = []
        for i in range(0, count, RATE):
            part = slice(i, i + RATE)
            good = np.ones(drive[part].size, np.bool_)
            self.monitor.update(drive[part], 0.1 * drive[part], reading[part], good)
            m = self.monitor
            out.append((dict(m.figures), dict(m.thresholds), m.mismatch))
        return out


@pytest.fixture(scope="module")
def learned() -> Watched:
    watched = Watched()
    watched.run = watched.feed(911)  # type: ignore[attr-defined]
    return watched


def test_thresholds_are_what_a_gumbel_distribution_exceeds_once_in_2000_blocks(
    learned: Watched,
) -> None:
    """Blocks of 20 s of motion count from its 101st second on, without the newest 12 s; the first
    third was seen while the baseline was found. A threshold is at least 1.3 times the largest
    figure."""
    run = learned.run  # type: ignore[attr-defined]
    figures, thresholds, _ = run[-1]
    lifted = 0
    for name, least in LEAST.items():
        # the first two seconds are too few to be judged; the 101st is the first that counts
        seen = [f[name] for f, _, _ in run[100:-12]]
        largest = np.array([max(seen[i : i + 20]) for i in range(0, len(seen) - 19, 20)])
        largest = largest[largest.size // 3 :]
        low, middle, high = np.quantile(largest, (0.25, 0.5, 0.75))
        unit = gumbel_r.ppf(0.75) - gumbel_r.ppf(0.25)
        scale = max(high - low, 0.05 * middle) / unit
        rare = middle + scale * (gumbel_r.ppf(1 - 1 / 2000) - gumbel_r.ppf(0.5))
        wanted = max(least, rare, 1.3 * largest.max()) * (1 + 4 / largest.size)
        assert thresholds[name] == pytest.approx(wanted, rel=2e-3), name
        assert figures[name] < thresholds[name]
        lifted += wanted > least * (1 + 4 / largest.size)
    assert lifted >= 1
    assert thresholds["fit"] == 40.0


@pytest.mark.parametrize("name", LEAST)
def test_where_figures_scatter_widely_a_threshold_is_exceeded_once_in_2000_blocks(
    learned: Watched, name: str
) -> None:
    """180 blocks count, whose largest figures are 4, 8 and 12 in turn: a scatter that neither the
    least threshold nor 1.3 times the largest figure covers."""
    level = copy.deepcopy(learned.monitor)._levels[name]
    for i in range(12 + 20 * 300):
        level.see((4.0, 8.0, 12.0)[i // 20 % 3] if i % 20 == 10 else 1.0)
    scale = (12.0 - 4.0) / (gumbel_r.ppf(0.75) - gumbel_r.ppf(0.25))
    rare = 8.0 + scale * (gumbel_r.ppf(1 - 1 / 2000) - gumbel_r.ppf(0.5))
    assert rare == pytest.approx(44.8, abs=0.1)
    assert level.threshold == pytest.approx(rare * (1 + 4 / 180), rel=1e-2)


@pytest.mark.parametrize("name", LEAST)
def test_no_threshold_falls_below_its_least(learned: Watched, name: str) -> None:
    """The least threshold is the smallest figure of interest; a good stage stays below it."""
    level = copy.deepcopy(learned.monitor)._levels[name]
    for _ in range(12 + 20 * 300):
        level.see(1e-3)
    assert level.threshold == pytest.approx(LEAST[name] * (1 + 4 / 180))


@pytest.mark.parametrize("name", LEAST)
def test_no_threshold_lies_below_1_3_times_the_largest_figure_in_order(
    learned: Watched, name: str
) -> None:
    level = copy.deepcopy(learned.monitor)._levels[name]
    for i in range(12 + 20 * 300):
        level.see(10.0 if i == 20 * 200 else 9.0)
    assert level.threshold == pytest.approx(13.0 * (1 + 4 / 180))


def test_the_flag_comes_with_health_above_1_and_goes_below_0_9(learned: Watched) -> None:
    """A vibration of 2.1 Hz grows by 0.3 noises a second, and then ends."""
    watched = copy.deepcopy(learned)
    t = np.arange(120 * RATE) / RATE
    grown = NOISE_UM * 0.3 * np.sin(2 * np.pi * 2.1 * t) * t
    run = watched.feed(120, grown)
    ended = watched.feed(60, 0.0)
    flagged = False
    seen = set()
    for figures, thresholds, mismatch in [*run, *ended]:
        health = max(figures[name] / thresholds[name] for name in figures)
        if health > 1.0:
            assert mismatch
        elif not flagged and health < 0.9:
            assert not mismatch
        elif flagged and health >= 0.9:
            assert mismatch
            seen.add("kept")
        if flagged and not mismatch:
            assert health < 0.9
            seen.add("ended")
        flagged = mismatch
    assert "ended" in seen


@pytest.mark.parametrize(("rms_noises", "flagged"), [(11.5, False), (14.0, True)])
def test_while_it_learns_only_a_fit_forty_times_worse_is_a_mismatch(
    rms_noises: float, flagged: bool
) -> None:
    """The model's own misfit counts as at least two noises: 2 * sqrt(40) = 12.6 noises rms."""
    watched = Watched()
    t = np.arange(60 * RATE) / RATE
    extra = NOISE_UM * np.sqrt(2) * rms_noises * np.sin(2 * np.pi * 0.5 * t)
    run = watched.feed(60, extra)
    assert any(mismatch for _, _, mismatch in run) == flagged
    assert watched.monitor.cause == "fit"
    assert all(thresholds["gain"] == np.inf for _, thresholds, _ in run)


def test_no_threshold_learns_from_what_is_flagged(learned: Watched) -> None:
    """A vibration of three minutes, nine blocks: it does not become the baseline."""
    watched = copy.deepcopy(learned)
    t = np.arange(180 * RATE) / RATE
    run = watched.feed(180, 20 * NOISE_UM * np.sin(2 * np.pi * 2.1 * t))
    first = next(i for i, (_, _, mismatch) in enumerate(run) if mismatch)
    assert first < 12
    for _, thresholds, mismatch in run[first:]:
        assert mismatch
        assert thresholds == run[first][1]


def test_a_shifted_zero_does_not_count_as_a_model_that_does_not_fit() -> None:
    """A gauge whose zero is 5 um off, in white noise; the misfit is counted in two noises."""
    figures, _, mismatch = Watched().feed(60, 5.0)[-1]
    assert figures["fit"] == pytest.approx(0.25, rel=0.4)
    assert not mismatch


def test_it_has_learned_after_400_s_of_motion_and_rest_does_not_count() -> None:
    watched = Watched()
    watched.feed(200)
    assert watched.monitor.learning == pytest.approx(0.5, abs=0.01)
    watched.feed(10, swing=0.0)  # for ten seconds it counts as just moved
    before = watched.monitor.learning
    watched.feed(100, swing=0.0)
    assert watched.monitor.learning == pytest.approx(before, abs=0.01)
    watched.feed(50, swing=0.0024, hz=1.0)  # 0.0017 ranges rms
    assert watched.monitor.learning == pytest.approx(before, abs=0.01)
    watched.feed(195, swing=0.0034, hz=1.0)  # 0.0024 ranges rms
    assert watched.monitor.learning == 0.0


@pytest.mark.parametrize(
    ("seconds", "moved_noises", "stuck"),
    [(0.8, 30.0, False), (1.3, 30.0, True), (3.0, 9.0, False), (3.0, 11.0, True)],
)
def test_a_reading_is_stuck_after_1_s_in_which_the_model_moved_by_10_noises(
    learned: Watched, seconds: float, moved_noises: float, stuck: bool
) -> None:
    monitor = copy.deepcopy(learned.monitor)
    count = round(seconds * RATE) + 1
    predicted = 5.0 + moved_noises * NOISE_UM * np.linspace(0.0, 1.0, count)
    monitor.update(predicted / 0.1, predicted, np.full(count, 5.0), np.ones(count, np.bool_))
    assert (monitor.stuck_s > 0.0) == stuck
