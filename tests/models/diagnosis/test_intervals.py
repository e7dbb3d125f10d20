"""How often the 95 % intervals of a diagnosis contain the truth, counted."""

import numpy as np
import pytest
from scipy.signal import cont2discrete, lfilter

from dehyst.models.diagnosis.base import compact_base, rich_base
from dehyst.models.diagnosis.data.noise import noise_rms
from dehyst.models.diagnosis.data.prepare import prepare
from dehyst.models.diagnosis.effects import Effect, apply_output_effects
from dehyst.models.diagnosis.fit import Problem
from dehyst.models.diagnosis.intervals import intervals
from dehyst.models.diagnosis.result import Value
from dehyst.models.physics import list_candidates
from dehyst.models.recording import Recording
from dehyst.models.signals.filters import dahl

DT, NOISE_UM, RUNS = 1e-3, 0.02, 55
TRUE = {"frequency_hz": 80.0, "damping": 0.05, "share": 0.6, "gain_um_per_unit": 0.3}


def recordings(noise: np.ndarray) -> list[Recording]:
    """Return a straight stage of 1.1 um/v followed by a mode and coupled to a second drive."""
    n = noise.size // 2
    t, out = np.arange(n) * DT, []
    for k in range(2):
        u = 5 + 3 * np.sin(2 * np.pi * (1.7 + k) * t) + 1.5 * np.sin(2 * np.pi * 9.3 * t + k)
        u *= np.clip(t / 0.2, 0, 1)
        other = np.cos(2 * np.pi * 4.1 * t + k) + 0.3 * np.sin(2 * np.pi * 31 * t)
        y = 1.1 * u + 0.3 * other + noise[k * n : (k + 1) * n]
        out.append(Recording(t, u, y, channels={"u2_v": other}, name=f"r{k}.csv"))
    return out


def mode_of(x: np.ndarray, frequency_hz: float, damping: float, dt: float) -> np.ndarray:
    """Return w^2 / (s^2 + 2 z w s + w^2) of x, which is linear between samples."""
    w = 2 * np.pi * frequency_hz
    num, den, _ = cont2discrete(([w * w], [1.0, 2 * damping * w, w * w]), dt, "foh")
    return lfilter(np.squeeze(num), den, x - x[0]) + x[0]


@pytest.mark.parametrize(
    ("base", "count", "together"),
    [(compact_base, 1600, 0), (compact_base, 1600, 15), (rich_base, 1600, 0), (rich_base, 4000, 4)],
)
def test_95_of_100_intervals_hold_the_true_value(base: object, count: int, together: int) -> None:
    """together: number of samples over which the noise is correlated, small enough that the
    independent samples outnumber the base's columns. Between 90 and 98 of 100, no slack."""
    quiet = prepare(recordings(np.zeros(count)))
    known = {c.key: c for c in list_candidates(quiet)}
    effects = [Effect(known["resonance"], (80.0, 0.05, 0.6)), Effect(known["coupling-u2_v"], ())]
    straight = 1.1 * quiet.u
    mode = apply_output_effects(quiet, effects, straight[:, None])[:, 0] - straight
    pole = np.exp(-1 / together) if together else 0.0
    hits = []
    for seed in range(RUNS):
        noise = np.random.default_rng(seed).standard_normal(count)
        noise = lfilter([NOISE_UM * np.sqrt(1 - pole**2)], [1, -pole], noise)
        data = prepare(recordings(mode + noise))
        problem = Problem(data, base(data))  # type: ignore[operator]
        fit = problem.refit(effects, rounds=3, settle=0.0)
        sigma = noise_rms(data, fit.residual(data))
        for values in intervals(problem, fit, sigma):
            hits += [v.low <= TRUE[key] <= v.high for key, v in values.items()]
    assert len(hits) == 4 * RUNS >= 200
    assert 0.90 <= np.mean(hits) <= 0.98, np.mean(np.reshape(hits, (-1, 4)), axis=0)


def test_a_parameter_that_does_nothing_leaves_the_others_their_intervals() -> None:
    """A drive that is clipped at the top only: the lower limit lies below all recorded drives."""
    t = np.arange(3000) * DT
    u = 5 + 4 * np.sin(2 * np.pi * 1.7 * t) + 0.8 * np.sin(2 * np.pi * 7.3 * t)
    noise = NOISE_UM * np.random.default_rng(2).standard_normal(t.size)
    data = prepare([Recording(t, u, 1.1 * np.minimum(u, 8.0) + noise)])
    clip = next(c for c in list_candidates(data) if c.key == "clip")
    problem = Problem(data, compact_base(data))
    fit = problem.refit([Effect(clip, (data.u_min - 0.1, 8.05))], settle=0.0)
    (values,) = intervals(problem, fit, NOISE_UM)
    top = values["max_v"]
    assert top.low < 8.0 < top.high
    assert 1e-4 < top.high - top.low < 0.05


def test_a_rise_is_known_though_its_time_constant_is_not() -> None:
    """One recording settles, another climbs so straight that its time constant is on its bound: the
    rise of each is nevertheless known."""
    given, ends = [], (4.0, 2.0)
    for seed, (end, tau) in enumerate(zip(ends, (2.0, 200.0), strict=True)):
        t = np.arange(round(end / DT)) * DT
        u = 5 + 3 * np.sin(2 * np.pi * 1.7 * t) + 1.5 * np.sin(2 * np.pi * 9.3 * t)
        rise = 0.2 * (1 - np.exp(-t / tau)) / (1 - np.exp(-end / tau))
        noise = NOISE_UM * np.random.default_rng(seed).standard_normal(t.size)
        given.append(Recording(t, u, 1.1 * u + rise + noise, name=f"r{seed}.csv"))
    data = prepare(given)
    trend = next(c for c in list_candidates(data) if c.key == "drift-trend")
    problem = Problem(data, compact_base(data))
    fit = problem.refit([Effect(trend, (2.5, 60.0))], settle=0.0)
    (values,) = intervals(problem, fit, NOISE_UM)
    assert values["rise_um"].low < 0.2 < values["rise_um"].high
    assert values["rise_um"].high - values["rise_um"].low < 0.02


def test_what_is_written_keeps_the_width_of_a_narrow_interval() -> None:
    said = Value(112.08490, 112.08482, 112.08498, "Hz").to_dict()
    assert said["low"] < said["value"] < said["high"]
    assert said["high"] - said["low"] == pytest.approx(1.6e-4, rel=0.05)


def test_a_line_is_known_no_better_than_the_clock_of_the_recorder() -> None:
    """A recorder whose clock is 8 ppm slow shows a line at 50 Hz a little above it, to 1 ppm."""
    t = np.arange(60_000) * DT
    u = 5 + 3 * np.sin(2 * np.pi * 1.7 * t)
    y = 1.1 * u + 0.3 * np.sin(2 * np.pi * 50.0 * t)
    y += NOISE_UM * np.random.default_rng(4).standard_normal(t.size)
    data = prepare([Recording(t * (1.0 - 8e-6), u, y)])
    hum = next(c for c in list_candidates(data) if c.key == "hum")
    problem = Problem(data, compact_base(data))
    fit = problem.refit([Effect(hum, (50.0,))], settle=0.0)
    (values,) = intervals(problem, fit, NOISE_UM)
    line = values["frequency_hz"]
    assert line.low < 50.0 < line.high < 50.002


def test_the_share_of_a_mode_holds_where_the_loop_is_of_another_class() -> None:
    """A smooth drive excites the mode only where the loop turns, and a Dahl loop turns otherwise
    than the plays that are fitted to it: the share comes out at 0.35."""
    fine = 10
    t, given, length = np.arange(8000 * fine) * DT / fine, [], np.array([4.0])
    for k in range(2):
        u = (
            5
            + 2.5 * np.sin(2 * np.pi * (0.9 + 0.3 * k) * t)
            + 1.5 * np.sin(2 * np.pi * 7.3 * t + k)
        )
        x = u + 2.0 * dahl(length, u, np.arange(t.size) == 0)[:, 0]
        y = (0.7 * x + 0.3 * mode_of(x, 60.0, 0.02, DT / fine))[::fine]
        y += 0.1 * NOISE_UM * np.random.default_rng(k).standard_normal(y.size)
        given.append(Recording(t[::fine], u[::fine], y, name=f"r{k}.csv"))
    data = prepare(given)
    known = next(c for c in list_candidates(data) if c.key == "resonance")
    problem = Problem(data, rich_base(data))
    fit = problem.refit([Effect(known, (60.0, 0.02, 0.3))], rounds=8, settle=0.0)
    (values,) = intervals(problem, fit, 0.1 * NOISE_UM)
    assert values["share"].low < 0.3 < values["share"].high < 0.5
