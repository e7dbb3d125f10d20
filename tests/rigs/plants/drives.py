"""Drives, neighbouring axis and room temperature of the proof's stages.

Every drive is a function of time that is evaluated on the plant's own fine grid `t` (N,) [s] and
lies within 0 to 10 V; `dt` is the recorder's period [s], which determines the drive's speed: what
is 30 Hz for a recorder at 1 kHz is 300 Hz for one at 10 kHz. Shares no code with the library.
"""

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray
from scipy import signal

Floats = NDArray[np.float64]
CENTRE_V, SWING_V = 5.0, 4.7
SOFT_START_SAMPLES = 500
STEP_SAMPLES = 1.5  # time constant of the generator's output filter, in periods of the recorder


def _started(u: Floats, t: Floats, dt: float) -> Floats:
    """Let a drive grow from 0 V in the soft start, so that it includes the virgin curve."""
    return u * np.clip(t / (SOFT_START_SAMPLES * dt), 0.0, 1.0)


def multisine(rng: np.random.Generator, t: Floats, dt: float) -> Floats:
    """Six to ten lines without a common period, 0.00035 to 0.03 of the rate, in 0.3 to 9.7 V."""
    u = np.zeros(t.size)
    for _ in range(rng.integers(6, 11)):
        f = np.exp(rng.uniform(np.log(3.5e-4), np.log(0.03)))
        u += f ** rng.uniform(-0.5, 0.1) * np.sin(2 * np.pi * (f * t / dt + rng.random()))
    swing = rng.uniform(0.85, 1.0) * SWING_V
    return _started(CENTRE_V + swing * u / np.max(np.abs(u)), t, dt)


def periodic(rng: np.random.Generator, t: Floats, dt: float) -> Floats:
    """A multisine with a period of 2000 samples that returns to 0 V once a period."""
    lines = np.array([2.0, 4.0, 5.0, 7.5, 10.0])
    x = t * 1e-3 / dt
    u = sum(np.cos(2 * np.pi * f * (x - 2.0)) / (1 + 0.15 * f) for f in lines)
    low, high = np.min(u), np.max(u)
    return _started(rng.uniform(7.0, 9.2) * (high - u) / (high - low), t, dt)


def triangle(rng: np.random.Generator, t: Floats, dt: float) -> Floats:
    """Full triangles from 0 V, 0.6 to 1.3 in 1000 samples."""
    return triangle_at(rng.uniform(0.6e-3, 1.3e-3) / dt, rng.uniform(7.0, 9.7))(rng, t, dt)


def triangle_at(hz: float, top: float) -> Callable[[np.random.Generator, Floats, float], Floats]:
    """One triangle, repeated, from 0 V."""

    def run(rng: np.random.Generator, t: Floats, dt: float) -> Floats:
        return top * (1.0 - np.abs(2.0 * np.mod(t * hz, 1.0) - 1.0))

    return run


def sine_at(*hz: float) -> Callable[[np.random.Generator, Floats, float], Floats]:
    """One sine, or the sum of several with equal swing, from the lower end up."""

    def run(rng: np.random.Generator, t: Floats, dt: float) -> Floats:
        swing = rng.uniform(0.7, 0.95) * CENTRE_V
        wave = sum(-np.cos(2 * np.pi * f * t) for f in hz) / len(hz)
        return swing * (1.0 + wave)

    return run


def chirp(rng: np.random.Generator, t: Floats, dt: float) -> Floats:
    """A sweep of 1 V or 2 V about the centre, to 0.09 of the rate, after a ramp to the centre."""
    phase = t * 1e-3 / dt + (0.09 - 1e-3) / dt * t**2 / (2.0 * t[-1])
    return _started(CENTRE_V + rng.uniform(1.0, 2.0) * np.sin(2 * np.pi * phase), t, dt)


def holds(rng: np.random.Generator, t: Floats, dt: float, rests: int = 12) -> Floats:
    """A rest at 0 V, then new random levels, through the output filter."""
    levels = np.r_[0.0, rng.uniform(0.6, 9.5, rests)]
    return _filtered(levels[np.minimum((t / t[-1] * rests).astype(int), rests)], t, dt)


def mixed(rng: np.random.Generator, t: Floats, dt: float) -> Floats:
    """The held-out waveform: another multisine, then a hold for the last third."""
    u = multisine(rng, t, dt)
    after = t >= 0.66 * t[-1]
    tail = np.r_[u[~after][-1], np.full(int(after.sum()), rng.uniform(2.5, 9.2))]
    return np.r_[u[~after], _filtered(tail, t, dt)[1:]]


def small_scan(
    start: float, swing: float
) -> Callable[[np.random.Generator, Floats, float], Floats]:
    """A constant level, then a small scan about it: two sines that grow from zero."""

    def run(rng: np.random.Generator, t: Floats, dt: float) -> Floats:
        f = np.array([1.0, 2.7]) * 1e-3 / dt * rng.uniform(0.8, 1.3)
        wave = 0.6 * np.sin(2 * np.pi * f[0] * t) + 0.4 * np.sin(2 * np.pi * f[1] * t)
        return start + swing * wave * np.clip(t / (SOFT_START_SAMPLES * dt), 0.0, 1.0)

    return run


def step_to(before: Floats, level: float, at: float, dt: float) -> Floats:
    """0 V until `at`, then a level, through the output filter: the history before a recording."""
    return _filtered(np.where(before < at, 0.0, level), before, dt)


def _filtered(steps: Floats, t: Floats, dt: float) -> Floats:
    keep = float(np.exp(-(t[1] - t[0]) / (STEP_SAMPLES * dt)))
    rest = np.array([keep * steps[0]])
    return np.asarray(signal.lfilter([1.0 - keep], [1.0, -keep], steps, zi=rest)[0])


def neighbour(rng: np.random.Generator, t: Floats, dt: float) -> Floats:
    """The other axis: a sine of its own for a while, then at rest at 5 V, repeatedly."""
    x = t * 1e-3 / dt
    f, phase = rng.uniform(0.5, 2.5), rng.random()
    wave = 5.0 + 3.5 * np.sin(2 * np.pi * (f * x + phase))
    return np.where(np.mod(x, 8.5) < 5.13, wave, 5.0)


def room(rng: np.random.Generator, t: Floats, constant: bool = False) -> Floats:
    """Room temperature [C]: from 22, a slow rise of about a degree with a wave on it."""
    if constant:
        return np.full(t.size, 22.0)
    rise, wave = rng.uniform(0.5, 1.2), rng.uniform(0.15, 0.3)
    cycles, phase = rng.uniform(1.2, 2.2), rng.uniform(-0.5, 0.5)
    swing = np.sin(2 * np.pi * cycles * t / t[-1] + phase) - np.sin(phase)
    return 22.0 + rise * t / t[-1] + wave * swing
