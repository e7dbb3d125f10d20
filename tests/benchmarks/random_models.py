"""Random models and nasty targets for the inverse, by seed."""

from dataclasses import dataclass

import numpy as np
from numba import njit
from numpy.typing import NDArray

from dehyst.models import compensate
from dehyst.models.compensator import Compensator
from dehyst.models.forward import simulate
from dehyst.models.model import Hysteresis, Model, Validity

Floats = NDArray[np.float64]
TARGETS = (
    "triangle", "square", "staircase", "random walk", "white noise", "beyond the range",
    "modulated sine", "sine",
)  # fmt: skip


def random_model(rng: np.random.Generator) -> Model:
    """Any units and direction; lags of up to 10 ms of either sign; a third each with monotone
    weights, with small operators that run the wrong way as in the paper's fits, and with rate
    weights that cancel to a thousandth."""
    n = int(rng.integers(2, 14))
    span = 10.0 ** rng.uniform(-1, 2)
    low = float(rng.choice([0.0, -span / 2, rng.uniform(-span, span)]))
    r = (np.arange(n) / n) ** rng.choice([1, 2, 3]) * span / 2 * rng.uniform(0.5, 1.0)
    sums = np.cumsum(rng.uniform(0.0, 1.0, n)) / n + rng.uniform(0.3, 1.0)
    kind = rng.integers(0, 3)
    if kind == 1:
        r[1:] = np.sort(np.append(r[2:], rng.uniform(1e-4, 1e-2) * span))
        sums[0] *= rng.uniform(-8, 0.2)
    tau = 10.0 ** rng.uniform(-4, -2) * rng.choice([-1.0, 1.0])
    turn = rng.normal(0, 0.3, n) * tau / span * sums.mean()
    turn[-1] = 2 * tau / span * sums.mean()
    if kind == 2:
        r[1:] = np.sort(np.append(r[2:], rng.uniform(1e-4, 1e-3) * span))
        turn[0] *= 1000.0
    direction = rng.choice([-1.0, 1.0])
    z = span * float(sums.max())
    c = np.array([rng.normal() * z, 1.0, rng.normal(0, 0.1) / z, rng.normal(0, 0.1) / z**2])
    c *= 10.0 ** rng.uniform(-1, 3) * direction
    offset = float(rng.choice([0.0, low + span / 2]))
    rate = span * 2 * np.pi * 10.0 ** rng.uniform(0.5, 1.5)
    return Model(
        Hysteresis(
            r=r, b=np.diff(sums, prepend=0.0), k=np.diff(turn, prepend=0.0), c=c, u_offset=offset
        ),
        Validity(low, low + span, float(rate) if rng.random() < 0.7 else None),
    )


def random_target(
    rng: np.random.Generator, model: Model, period_s: float, samples: int, kind: int
) -> tuple[Floats, float]:
    """One of TARGETS (N,), and the stroke it is made for."""
    v = model.validity
    u = np.linspace(v.drive_min, v.drive_max, 60)
    y = simulate(model.hysteresis, np.concatenate([u, u[::-1]]), 1e9)
    low, high = float(y.min()), float(y.max())
    t = np.arange(samples) * period_s
    f = 10.0 ** rng.uniform(0.0, 1.3)
    phase = (f * t + rng.random()) % 1.0
    if kind == 0:
        wave = 2 * np.abs(2 * phase - 1) - 1
    elif kind == 1:
        wave = np.sign(phase - 0.5)
    elif kind == 2:
        wave = np.floor(phase * 6) / 3 - 1
    elif kind == 3:
        wave = np.cumsum(rng.normal(0, 1, samples))
        wave /= np.abs(wave).max()
    elif kind == 4:
        wave = rng.normal(0, 0.4, samples)
    elif kind == 5:
        wave = 2.0 * np.sin(2 * np.pi * phase)
    elif kind == 6:
        wave = np.sin(2 * np.pi * phase) * np.sin(0.74 * np.pi * f * t)
    else:
        wave = np.sin(2 * np.pi * phase)
    size = rng.uniform(0.2, 0.9)
    return 0.5 * (low + high) + 0.5 * (high - low) * size * wave, high - low


def random_case(seed: int) -> tuple[Model, Floats, float, float, str, bool]:
    """Model, target, period, slew, name of the target, and whether the stream starves."""
    rng = np.random.default_rng(seed)
    model = random_model(rng)
    period = float(rng.choice([2e-4, 1e-3, 5e-3]))
    kind = int(rng.integers(0, len(TARGETS)))
    target, _ = random_target(rng, model, period, round(0.8 / period), kind)
    span = model.validity.drive_max - model.validity.drive_min
    return (
        model,
        target,
        period,
        span * 10.0 ** rng.uniform(1.7, 4),
        TARGETS[kind],
        rng.random() < 0.3,
    )


@njit(cache=True, nogil=True)
def _run(
    weights, c, knots, fixed, setting, table, params, numbers, plays, work, states, scratch, inner,
    ring, seq, y, channels, result, target, wide, starves, drive,
):  # type: ignore[no-untyped-def]  # fmt: skip
    """What the daemon's loop does, without the daemon: propose, apply."""
    n = target.size
    for i in range(n):
        valid = min(wide, n - i)
        if starves and 0.3 * n < i < 0.35 * n:
            valid = 0
        elif starves and 0.5 * n < i < 0.6 * n:
            valid = 1
        compensate.step(
            weights, c, knots, fixed, setting, table, params, numbers, plays, work, states,
            scratch, inner, ring, seq, y, target[i : i + wide], valid, channels, result,
        )  # fmt: skip
        drive[i] = result[0]
        compensate.applied(
            weights, c, knots, fixed, setting, table, params, numbers, plays, states, inner, y,
            channels, drive[i], True, result,
        )  # fmt: skip


def driven(c: Compensator, target: Floats, starves: bool, start: float) -> Floats:
    """Drive (N,) of a compensator along a target (N,), its stream starving twice or never."""
    s, drive = c.init(start), np.empty(target.size)
    _run(
        c.weights, c.c, c._knots, c._fixed, c._setting, c.table, c.params, s.numbers, s.plays,
        s.work, s.blocks, s.scratch, s.inner, s.ring, s.seq, s.y, s.channels, s.result, target,
        c.window_samples, starves, drive,
    )  # fmt: skip
    return drive


@dataclass(frozen=True)
class Outcome:
    """limits: whether every drive was finite and within range and slew; rms: error by mode, in
    units of the noise."""

    limits: bool
    rms: dict[str, float]

    def excess(self, mode: str) -> float:
        """By how many times the noise the mode is worse than the static inverse."""
        return self.rms[mode] - self.rms["static"]


def outcome(seed: int) -> Outcome:
    """All modes on one random case."""
    model, target, dt, slew, _, starves = random_case(seed)
    v = model.validity
    rms, limits = {}, True
    for mode in ("static", "causal", "preview"):
        c = Compensator(model, dt, v.drive_min, v.drive_max, slew, mode, 0.1)
        drive = driven(c, target, starves, v.drive_min)
        steps = np.abs(np.diff(drive, prepend=v.drive_min))
        limits = limits and bool(np.all(np.isfinite(drive)) and steps.max() <= slew * dt * 1.000001)
        limits = limits and drive.min() >= v.drive_min - 1e-9 and drive.max() <= v.drive_max + 1e-9
        y = simulate(model.hysteresis, np.concatenate([[v.drive_min], drive]), dt)[1:]
        rms[mode] = float(np.sqrt(np.mean((y - target) ** 2))) / c.noise
    return Outcome(limits, rms)
