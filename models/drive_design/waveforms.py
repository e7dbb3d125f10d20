"""The drives from which the experiment that distinguishes two candidates is chosen."""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from dehyst.models.errors import BadInput
from dehyst.models.recording import Floats

LEAST_SEPARATING, MOST_SEPARATING = 200, 2_000_000
"""Samples of a drive that separates effects: fewer show none, and `identify` uses no more rows."""


@dataclass(frozen=True)
class Limits:
    """Limits of the stage's drive: drive range [drive unit], steepest rate [drive unit / s],
    sampling period [s], length [s]."""

    drive_min: float
    drive_max: float
    rate_max: float
    period_s: float
    seconds: float = 20.0

    def __post_init__(self) -> None:
        if not self.drive_max > self.drive_min:
            raise BadInput("the drive's range is empty: its end must be above its start")
        if not (self.rate_max > 0 and self.period_s > 0):
            raise BadInput("the drive's rate and the sampling period must be greater than 0")
        if not LEAST_SEPARATING <= self.seconds / self.period_s <= MOST_SEPARATING:
            raise BadInput(
                f"the drive must be {LEAST_SEPARATING} to {MOST_SEPARATING} samples long"
            )

    @property
    def middle(self) -> float:
        """Centre of the range."""
        return 0.5 * (self.drive_min + self.drive_max)

    @property
    def span(self) -> float:
        """Width of the range."""
        return self.drive_max - self.drive_min

    @property
    def times(self) -> Floats:
        """(N,) sampling times [s]."""
        return np.arange(round(self.seconds / self.period_s), dtype=np.float64) * self.period_s


@dataclass(frozen=True)
class Waveform:
    """A named drive; says: one sentence for the person who runs it."""

    name: str
    says: str
    make: Callable[[Limits], Floats]


def _ramped(limits: Limits, wanted: Floats) -> Floats:
    """Return the wanted drive, starting at the low end and limited to the allowed rate."""
    most = 0.98 * limits.rate_max * limits.period_s  # just below the limit, for rounding
    out = np.empty(wanted.size)
    v = limits.drive_min
    for i, w in enumerate(wanted.tolist()):
        v += min(max(w - v, -most), most)
        out[i] = v
    return out


def _levels(limits: Limits, shares: list[float], hold_s: float) -> Floats:
    index = (limits.times / hold_s).astype(int)
    levels = np.array([limits.drive_min + limits.span * s for s in shares])
    return _ramped(limits, levels[index % levels.size])


def _holds(limits: Limits) -> Floats:
    shares = [0.0, 0.9, 0.3, 0.6, 0.1, 0.8, 0.5, 0.95]  # of the range: moves of many sizes
    return _levels(limits, shares, limits.seconds / len(shares))


def _one_step(limits: Limits) -> Floats:
    return _levels(limits, [0.0, 0.9, 0.9, 0.9, 0.1, 0.1], limits.seconds / 6)


def _rest(limits: Limits) -> Floats:
    return _ramped(limits, np.full(limits.times.size, limits.middle))


def _chirp(limits: Limits, share: float, top: float) -> Floats:
    """Return a sweep about the middle; where the rate would be too high, its amplitude is
    reduced."""
    t = limits.times
    nyquist = 0.5 / limits.period_s
    low, high = 1.0 / limits.seconds * 10, top * nyquist  # Hz: from ten waves in the whole time
    growth = np.log(high / low)
    f = low * np.exp(growth * t / limits.seconds)
    phase = 2 * np.pi * low * limits.seconds / growth * (np.exp(growth * t / limits.seconds) - 1)
    allowed = 0.9 * limits.rate_max / (2 * np.pi * f)  # of the rate: a margin
    amplitude = np.minimum(share * limits.span, allowed)
    return _ramped(limits, limits.middle + amplitude * np.sin(phase))


def _small_chirp(limits: Limits) -> Floats:
    return _chirp(limits, 0.04, 0.8)  # of the range; up to this part of the Nyquist frequency


def _large_chirp(limits: Limits) -> Floats:
    return _chirp(limits, 0.4, 0.4)  # of both


def _random_steps(limits: Limits) -> Floats:
    rng = np.random.default_rng(1)
    out = np.empty(0)
    while out.size < limits.times.size:
        long = rng.integers(20, 200)  # samples: holds of many lengths
        out = np.r_[out, np.full(long, limits.middle + 0.2 * limits.span * rng.uniform(-1, 1))]
    return _ramped(limits, out[: limits.times.size])


def _triangle(limits: Limits, period_s: float, share: Floats | float) -> Floats:
    phase = np.mod(limits.times / period_s, 1.0)
    shape = 1.0 - np.abs(2.0 * phase - 1.0)
    return _ramped(limits, limits.drive_min + limits.span * share * shape)


def _slow_triangle(limits: Limits) -> Floats:
    return _triangle(limits, limits.seconds / 8, 0.95)  # eight, over most of the range


def _fast_and_slow(limits: Limits) -> Floats:
    """Return the same triangles at three speeds, the fastest as fast as allowed."""
    third = np.minimum(3 * np.arange(limits.times.size) // limits.times.size, 2)
    fastest = max(2.5 * limits.span / limits.rate_max, 16 * limits.period_s)  # s; 2: at the limit
    slowest = max(limits.seconds / 6, fastest)
    parts = [_triangle(limits, p, 0.97) for p in (slowest, (slowest * fastest) ** 0.5, fastest)]
    return _ramped(limits, np.choose(third, parts))


def _burst_then_hold(limits: Limits) -> Floats:
    """Return a long burst of fast motion, then a rest at the middle."""
    t = limits.times
    # 80 Hz heats a stage; the others are within the rate, and ten samples to a period
    f = min(80.0, 0.9 * limits.rate_max / (2 * np.pi * 0.35 * limits.span), 0.1 / limits.period_s)
    on = (t > 0.1 * limits.seconds) & (t < 0.5 * limits.seconds)
    burst = np.where(on, 0.35 * limits.span, 0.0) * np.sin(2 * np.pi * f * t)
    return _ramped(limits, limits.middle + burst)


WAVEFORMS = (
    Waveform("rest", "hold mid-range; let everything else run as usual", _rest),
    Waveform("holds", "step up and down to several levels and hold each", _holds),
    Waveform("one step", "one large step up, a long hold, one down, a long hold", _one_step),
    Waveform("small sweep", "a sweep to high frequency at 4 % of the range", _small_chirp),
    Waveform("large sweep", "a sweep at 40 % of the range, as fast as allowed", _large_chirp),
    Waveform("random steps", "steps of random height and length", _random_steps),
    Waveform("slow triangle", "full triangles, repeated", _slow_triangle),
    Waveform("three speeds", "the same triangle at three speeds", _fast_and_slow),
    Waveform("burst", "a fast burst, then a long rest", _burst_then_hold),
)
