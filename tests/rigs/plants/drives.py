"""Drives, neighbouring axis and room temperature of the proof's stages, at 1 kHz.

Every function returns what the recorder writes down: samples at DT. Between the samples the
amplifier's output runs straight (the plant integrates on a finer grid, see proof_stages).
Shares no code with the library.
"""

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]
DT = 1e-3
CENTRE_V, SWING_V = 5.0, 4.7
SOFT_START_S = 0.5
STEP_TAU_S = 1.2e-3  # the generator's output filter: a step is not steeper than this


def _times(seconds: float) -> Floats:
    return np.arange(round(seconds / DT) + 1) * DT


def _started(u: Floats, t: Floats) -> Floats:
    """Grown from 0 V within the soft start, so that the virgin curve is part of the recording."""
    return u * np.clip(t / SOFT_START_S, 0.0, 1.0)


def multisine(rng: np.random.Generator, seconds: float) -> Floats:
    """Six to ten lines without a common period, 0.3 to 30 Hz, inside 0.3 to 9.7 V."""
    t = _times(seconds)
    u = np.zeros(t.size)
    for _ in range(rng.integers(6, 11)):
        f = np.exp(rng.uniform(np.log(0.35), np.log(30.0)))
        u += f ** rng.uniform(-0.5, 0.1) * np.sin(2 * np.pi * (f * t + rng.random()))
    swing = rng.uniform(0.85, 1.0) * SWING_V
    return _started(CENTRE_V + swing * u / np.max(np.abs(u)), t)


def periodic(rng: np.random.Generator, seconds: float) -> Floats:
    """A multisine with a period of 2 s that returns to 0 V once a period."""
    t = _times(seconds)
    lines = np.array([2.0, 4.0, 5.0, 7.5, 10.0])
    u = sum(np.cos(2 * np.pi * f * (t - 2.0)) / (1 + 0.15 * f) for f in lines)
    low, high = np.min(u), np.max(u)
    flip = (high - u) / (high - low)
    return _started(rng.uniform(7.0, 9.2) * flip, t)


def triangle(rng: np.random.Generator, seconds: float) -> Floats:
    """Full triangles of 0.6 to 1.3 Hz from 0 V."""
    t = _times(seconds)
    phase = np.mod(t * rng.uniform(0.6, 1.3), 1.0)
    return rng.uniform(7.0, 9.7) * (1.0 - np.abs(2.0 * phase - 1.0))


def chirp(rng: np.random.Generator, seconds: float) -> Floats:
    """A sweep of 1 V or 2 V about the centre, 1 Hz to 90 Hz, after a ramp to the centre."""
    t = _times(seconds)
    phase = t + (90.0 - 1.0) * t**2 / (2.0 * seconds)
    return _started(CENTRE_V + rng.uniform(1.0, 2.0) * np.sin(2 * np.pi * phase), t)


def holds(rng: np.random.Generator, seconds: float, rest_s: float = 2.5) -> Floats:
    """A rest at 0 V, then a new random level every 2.5 s, through the output filter."""
    t = _times(seconds)
    levels = np.r_[0.0, rng.uniform(0.6, 9.5, int(np.ceil(seconds / rest_s)))]
    return _filtered(levels[(t / rest_s).astype(int)])


def mixed(rng: np.random.Generator, seconds: float = 16.0) -> Floats:
    """The waveform that is held out: ten seconds of another multisine, then a hold."""
    t = _times(seconds)
    u = multisine(rng, seconds)
    after = t >= 10.0
    level = rng.uniform(2.5, 9.2)
    tail = _filtered(np.r_[u[~after][-1], np.full(int(after.sum()), level)])[1:]
    return np.r_[u[~after], tail]


def _filtered(steps: Floats) -> Floats:
    keep = np.exp(-DT / STEP_TAU_S)
    out = np.empty(steps.size)
    last = steps[0]
    for i, level in enumerate(steps):
        last = keep * last + (1.0 - keep) * level
        out[i] = last
    return out


def neighbour(rng: np.random.Generator, samples: int) -> Floats:
    """The other axis: a sine of its own for a while, then at rest at 5 V, again and again."""
    t = np.arange(samples) * DT
    f, phase = rng.uniform(0.5, 2.5), rng.random()
    moving = np.mod(t, 8.5) < 5.13
    return np.where(moving, 5.0 + 3.5 * np.sin(2 * np.pi * (f * t + phase)), 5.0)


def room(rng: np.random.Generator, samples: int, constant: bool = False) -> Floats:
    """Room temperature [C]: from 22, a slow rise of about a degree with a wave on it."""
    t = np.arange(samples) * DT
    if constant:
        return np.full(samples, 22.0)
    rise, wave = rng.uniform(0.5, 1.2), rng.uniform(0.15, 0.3)
    end = t[-1]
    cycles, phase = rng.uniform(1.2, 2.2), rng.uniform(-0.5, 0.5)
    swing = np.sin(2 * np.pi * cycles * t / end + phase) - np.sin(phase)
    return 22.0 + rise * t / end + wave * swing
