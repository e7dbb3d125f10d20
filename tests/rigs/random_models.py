"""Random models and difficult targets for the inverse, by seed."""

from dataclasses import dataclass

import numpy as np
from numba import njit
from numpy.typing import NDArray

from dehyst.models.arrays import Floats
from dehyst.models.hysteresis.forward import simulate_hysteresis
from dehyst.models.inverse import sample
from dehyst.models.inverse.compensator import Compensator
from dehyst.models.inverse.state import inverse_at
from dehyst.models.model import Hysteresis, Model, Validity

Ints = NDArray[np.int64]
NEVER, DROUGHT, ONE_IN_A_HUNDRED = range(3)  # how a stream starves
TARGETS = (
    "triangle", "square", "staircase", "random walk", "white noise", "beyond the range",
    "modulated sine", "sine",
)  # fmt: skip


def random_model(rng: np.random.Generator) -> Model:
    """Return a model with any units and direction; lags of up to 10 ms of either sign; a third each
    with monotone weights, with small operators of the wrong sign as in the paper's fits, and with
    rate weights that cancel to a thousandth."""
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
    """Return one of TARGETS (N,), and the stroke for which it is made."""
    v = model.validity
    u = np.linspace(v.drive_min, v.drive_max, 60)
    y = simulate_hysteresis(model.hysteresis, np.concatenate([u, u[::-1]]), 1e9)
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


def random_case(seed: int) -> tuple[Model, Floats, float, float, str, int]:
    """Return model, target, period, slew, name of the target, and how the stream starves
    (STARVING)."""
    rng = np.random.default_rng(seed)
    model = random_model(rng)
    period = float(rng.choice([2e-4, 1e-3, 5e-3]))
    kind = int(rng.integers(0, len(TARGETS)))
    target, _ = random_target(rng, model, period, round(0.8 / period), kind)
    slew = (model.validity.drive_max - model.validity.drive_min) * 10.0 ** rng.uniform(1.7, 4)
    chance = rng.random()
    starving = DROUGHT if chance < 0.2 else ONE_IN_A_HUNDRED if chance < 0.4 else NEVER
    return model, target, period, slew, TARGETS[kind], starving


def known_ahead(starving: int, samples: int, wide: int) -> Ints:
    """Return (N,) the number of targets known at each sample, including its own."""
    at = np.arange(samples)
    known = np.minimum(wide, samples - at)
    if starving == DROUGHT:
        known[(at > 0.3 * samples) & (at < 0.35 * samples)] = 0
        known[(at > 0.5 * samples) & (at < 0.6 * samples)] = 1
    elif starving == ONE_IN_A_HUNDRED:
        rng = np.random.default_rng(samples)
        short = rng.random(samples) < 0.01
        known[short] = np.minimum(known, rng.choice([0, 1, wide // 3], samples))[short]
    return known.astype(np.int64)


@njit(cache=True, nogil=True)
def _run(address, target, wide, known, drive):  # type: ignore[no-untyped-def]
    """Run the daemon's loop without the daemon: propose, apply. numba keeps this code when a record
    of the inverse changes: then change this file as well."""
    inverse = inverse_at(address)
    for i in range(target.size):
        sample.propose_drive(inverse, target[i : i + wide], known[i])
        drive[i] = inverse.result[0].drive
        sample.applied(inverse, drive[i], True)


def driven(c: Compensator, target: Floats, starving: int, start: float) -> Floats:
    """Return the drive (N,) of a compensator along a target (N,) whose stream starves like this."""
    state, drive = c.init(start), np.empty(target.size)
    known = known_ahead(int(starving), target.size, c.window_samples)
    _run(state.address, target, c.window_samples, known, drive)
    return drive


@dataclass(frozen=True)
class Outcome:
    """The result. limits: whether every drive was finite and within range and slew; starving: how
    the stream starved; rms: error by mode, in units of the noise."""

    limits: bool
    starving: int
    rms: dict[str, float]

    def excess(self, mode: str) -> float:
        """Return by how many times the noise the mode is worse than the static inverse."""
        return self.rms[mode] - self.rms["static"]

    def times(self, mode: str) -> float:
        """Return the ratio to the static inverse's error, with the noise added to both."""
        return (1.0 + self.rms[mode]) / (1.0 + self.rms["static"])


def outcome(seed: int, modes: tuple[str, ...] = ("static", "causal", "preview")) -> Outcome:
    """Run modes on one random case."""
    model, target, dt, slew, _, starving = random_case(seed)
    v = model.validity
    rms, limits = {}, True
    for mode in modes:
        c = Compensator(model, dt, v.drive_min, v.drive_max, slew, mode, 0.1)
        drive = driven(c, target, starving, v.drive_min)
        steps = np.abs(np.diff(drive, prepend=v.drive_min))
        limits = limits and bool(np.all(np.isfinite(drive)) and steps.max() <= slew * dt * 1.000001)
        limits = limits and drive.min() >= v.drive_min - 1e-9 and drive.max() <= v.drive_max + 1e-9
        y = simulate_hysteresis(model.hysteresis, np.concatenate([[v.drive_min], drive]), dt)[1:]
        rms[mode] = float(np.sqrt(np.mean((y - target) ** 2))) / c.noise
    return Outcome(limits, starving, rms)
