"""Design a drive for identification: superimposed sines (Qin et al., Eq. 9).

    u(t) = middle + sum_i A_i sin(2 pi f_i t - pi / 2)

Every sine starts in its trough, so the drive starts at the bottom of its range with zero rate, and
every sine runs a whole number of periods, so it ends there too. Frequencies and amplitudes are
searched so that drive and rate together are covered evenly, with loops of all sizes.
"""

import math
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from dehyst.models.drive_design.coverage import TUNING as COVERAGE
from dehyst.models.drive_design.coverage import count_loop_sizes
from dehyst.models.errors import BadInput
from dehyst.models.recording import Floats


class Tuning(NamedTuple):
    """Rules of thumb, checked by tests/models/drive_design; no benchmark has set them."""

    sines: int = 3
    trials: int = 300
    coarse: int = 3000  # samples used to judge a drive
    slowest: float = 0.1  # of the band: slower sines leave too little amplitude for the fast ones
    least_cycles: int = 3  # of the slowest sine in the whole drive
    finest: int = 12  # samples per period of the fastest sine
    reach: float = 0.91  # of the range, which the sines should reach together


TUNING = Tuning()
SINES = TUNING.sines


@dataclass(frozen=True)
class Excitation:
    """A drive. t_s, u: (N,); amplitudes, frequencies_hz: of the sines; rest_s: rest at each end;
    lead_s: smooth move from the start to the bottom of the range; rate_max: largest rate
    [unit/s]."""

    t_s: Floats
    u: Floats
    amplitudes: tuple[float, ...]
    frequencies_hz: tuple[float, ...]
    rest_s: float
    lead_s: float
    rate_max: float


def design(
    low: float,
    high: float,
    band_hz: float | tuple[float, float],
    duration_s: float,
    sample_hz: float,
    *,
    sines: int = TUNING.sines,
    slew_per_s: float | None = None,
    seed: int = 0,
) -> Excitation:
    """Design a drive between low and high, with sines up to band_hz, over duration_s.

    band_hz: the fastest sine, or the slowest and the fastest: a narrow band keeps creep that
    happens between slow and fast out of a model for motions of about this speed. slew_per_s:
    largest rate allowed [unit / s]. Raises BadInput, naming the argument, when they contradict each
    other.
    """
    slowest_hz, band_hz = band_hz if isinstance(band_hz, tuple) else (None, band_hz)
    _check(low, high, band_hz, duration_s, sample_hz, sines, slew_per_s)
    slowest_hz = TUNING.slowest * band_hz if slowest_hz is None else slowest_hz
    start = min(max(0.0, low), high)
    rest_s = min(0.5, 0.05 * duration_s)  # s; at most a twentieth of the time
    lead_s = 0.0 if start == low else min(1.0, 0.1 * duration_s)  # s; a tenth
    body_s = duration_s - 2.0 * (rest_s + lead_s)
    half = 0.5 * (high - low)
    fastest = math.floor(band_hz * body_s)
    slowest = max(TUNING.least_cycles, math.ceil(slowest_hz * body_s))
    if fastest < slowest + sines - 1:
        # at least 0.7 of the time is left beside rests and leads
        shortest = (TUNING.least_cycles + sines + 1) / band_hz / 0.7
        raise BadInput(
            f"duration: {duration_s:g} s is too short for {sines} sines up to {band_hz:g} Hz; "
            f"take at least {shortest:.2g} s or a wider band"
        )
    cycles, shares = _search(fastest, slowest, sines, slew_per_s, half, body_s, seed)
    amplitudes, frequencies = half * shares, cycles / body_s
    body = np.arange(round(body_s * sample_hz) + 1) / sample_hz
    phase = 2.0 * np.pi * np.outer(body, frequencies)
    u_body = low + half - np.cos(phase) @ amplitudes
    u = np.concatenate(
        [
            np.full(round(rest_s * sample_hz), start),
            _glide(start, low, round(lead_s * sample_hz)),
            np.clip(u_body, low, high),  # rounding only
            _glide(low, start, round(lead_s * sample_hz)),
            np.full(round(rest_s * sample_hz), start),
        ]
    )
    t = np.arange(u.size) / sample_hz
    rate_max = float(np.max(np.abs(np.diff(u)))) * sample_hz
    return Excitation(
        t,
        u,
        tuple(amplitudes.tolist()),
        tuple(frequencies.tolist()),
        rest_s,
        lead_s,
        rate_max,
    )


def _check(
    low: float,
    high: float,
    band_hz: float,
    duration_s: float,
    sample_hz: float,
    sines: int,
    slew_per_s: float | None,
) -> None:
    if not (math.isfinite(low) and math.isfinite(high) and high > low):
        raise BadInput(f"range: the upper end must be above the lower, not {low:g} to {high:g}")
    for name, value in (("band", band_hz), ("duration", duration_s), ("sampling rate", sample_hz)):
        if not (math.isfinite(value) and value > 0):
            raise BadInput(f"{name}: must be greater than 0, not {value:g}")
    if duration_s * sample_hz > 50e6:  # samples: 0.4 GB a column
        raise BadInput(f"duration: {duration_s * sample_hz:.3g} samples are too many (50 million)")
    if sample_hz < TUNING.finest * band_hz:
        raise BadInput(
            f"sampling rate: {sample_hz:g} Hz is too low for a band of {band_hz:g} Hz; "
            f"take at least {TUNING.finest * band_hz:g} Hz"
        )
    if not 2 <= sines <= 8:  # one has a single size of loop; of many, each is small
        raise BadInput(f"sines: 2 to 8, not {sines}")
    if slew_per_s is not None and not slew_per_s > 0:
        raise BadInput(f"slew: must be greater than 0, not {slew_per_s:g}")


def _search(
    fastest: int,
    slowest: int,
    sines: int,
    slew: float | None,
    half: float,
    body_s: float,
    seed: int,
) -> tuple[Floats, Floats]:
    """Return (cycles, shares of the half range) of the sines: the most even set of many tried,
    preferring those that cover nearly all of the range in loops of enough sizes."""
    rng = np.random.default_rng(seed)
    best, found = (-1.0, 0, -1.0), None
    for _ in range(TUNING.trials):
        inner = rng.uniform(np.log(slowest), np.log(fastest), sines - 1)
        cycles = np.unique(np.append(np.round(np.exp(inner)), float(fastest)))
        # the common divisor is the number of times that the drive repeats itself
        if cycles.size < sines or math.gcd(*(int(c) for c in cycles)) > max(1, slowest // 4):
            continue
        shares = rng.dirichlet(np.full(sines, 2.0))  # 2: rarely near 0
        shares = np.maximum(shares, 0.05)  # of the half range: no sine is lost
        shares /= shares.sum()
        if slew is not None and 2 * np.pi * half * float(shares @ cycles) / body_s > slew:
            continue
        u = _sum_sines(cycles, shares)
        score = (
            min(0.5 + 0.5 * float(u.max()), TUNING.reach),
            min(_count_sizes(u), COVERAGE.enough_sizes),
            _measure_evenness(cycles, shares),
        )
        if score > best:
            best, found = score, (cycles, shares)
    if found is None:
        raise BadInput(
            f"slew: {slew:g} per second is too slow for this range and band; "
            "lower the band, narrow the range, or lengthen the drive"
            if slew is not None
            else "band: no set of sines fits; lengthen the drive or widen the band"
        )
    return found


def _sum_sines(cycles: Floats, shares: Floats) -> Floats:
    """Return one period of the drive, from -1 up to 1 at most."""
    phase = 2.0 * np.pi * np.arange(TUNING.coarse) / TUNING.coarse
    return np.asarray(-np.cos(np.outer(phase, cycles)) @ shares)


def _count_sizes(u: Floats) -> int:
    """Return how many classes of loop sizes occur."""
    return int(np.count_nonzero(count_loop_sizes(u)))


def _measure_evenness(cycles: Floats, shares: Floats) -> float:
    """Return the normalised entropy of drive and rate over their cells, 0 to 1, times that of the
    rates alone."""
    phase = 2.0 * np.pi * np.arange(TUNING.coarse) / TUNING.coarse
    angle = np.outer(phase, cycles)
    u = -np.cos(angle) @ shares
    rate = np.sin(angle) @ (shares * cycles)
    rate /= np.max(np.abs(rate))
    cells, _, _ = np.histogram2d(
        u, rate, bins=(COVERAGE.drive_bins, COVERAGE.rate_bins), range=((-1.0, 1.0), (-1.0, 1.0))
    )
    speeds = np.histogram(np.abs(rate), bins=8, range=(0.0, 1.0))[0]  # classes of speed
    return _compute_entropy(cells.ravel()) * _compute_entropy(speeds)


def _compute_entropy(counts: Floats) -> float:
    p = counts[counts > 0] / counts.sum()
    return float(-np.sum(p * np.log(p)) / np.log(counts.size))


def _glide(start: float, stop: float, count: int) -> Floats:
    """Return a raised-cosine move from start to stop, with zero rate at both ends."""
    way = 0.5 * (1.0 - np.cos(np.pi * np.arange(count) / max(1, count)))
    return start + (stop - start) * way
