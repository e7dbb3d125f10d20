"""Effects that bend a loop independently of time, and effects that exist only part of the time.

The first group depends only on shape: one value per drive history, no clock. The second is reported
with its time. See `effects` for the form. Shares no code with the library.
"""

import numpy as np
from numba import njit
from tests.rigs.plants.drives import Floats
from tests.rigs.plants.effects import Effect, World


@njit(cache=True, nogil=True)
def _dahl(x: Floats, length: float, power: float) -> Floats:
    """Dahl: dz = (1 - z sgn dx)^power dx / length, |z| <= 1; solved exactly between samples."""
    out = np.empty(x.size)
    z = 0.0
    last = x[0]
    for t in range(x.size):
        dx = x[t] - last
        last = x[t]
        sign = 1.0 if dx > 0 else -1.0
        room = max(1.0 - sign * z, 1e-9)
        way = abs(dx) / length
        if power == 1.0:
            room *= np.exp(-way)
        else:
            room = (room ** (1.0 - power) + (power - 1.0) * way) ** (1.0 / (1.0 - power))
        z = sign * (1.0 - room)
        out[t] = z
    return out


def presliding(rng: np.random.Generator, own: bool, dt: float) -> Effect:
    """A guide whose balls roll in their tracks before they slide: a memory of the displacement."""
    length, power = rng.uniform(0.05, 0.3), float(rng.choice([1.0, rng.uniform(1.2, 2.0)]))

    def run(x: Floats, w: World, s: float) -> Floats:
        return x - s * _dahl(x, length, power)

    return Effect("shape", "presliding friction", "stage", run, 0.1, 2.0, lambda s: {})


def curved_sensor(rng: np.random.Generator, own: bool, dt: float) -> Effect:
    """A reading that is not linear: a cubic, or a sine along the range."""
    period, phase = rng.uniform(3.0, 9.0), rng.uniform(0, 2 * np.pi)
    third = rng.random() < 0.5

    def run(x: Floats, w: World, s: float) -> Floats:
        if third:
            z = (x - 5.0) / 5.0
            return x + s * z * (z * z - 0.5) * 2.0
        return x + s * (np.sin(2 * np.pi * x / period + phase) - np.sin(phase))

    return Effect("shape", "curved sensor", "reading", run, 0.1, 3.0, lambda s: {})


@njit(cache=True, nogil=True)
def _one_sided(u: Floats, halves: Floats) -> Floats:
    """Mean lead of the drive over dead bands while it rises; zero while it falls."""
    out = np.empty(u.size)
    p = np.full(halves.size, u[0])
    for t in range(u.size):
        total = 0.0
        for i in range(halves.size):
            p[i] = max(u[t] - halves[i], min(u[t] + halves[i], p[i]))
            total += max(u[t] - p[i], 0.0) / halves[i]
        out[t] = total / halves.size
    return out


def asymmetric(rng: np.random.Generator, own: bool, dt: float) -> Effect:
    """A ceramic that switches more easily in one direction, most in the middle of its range."""
    halves, middle = rng.uniform(0.3, 2.5, 4), rng.uniform(3.5, 6.5)

    def run(x: Floats, w: World, s: float) -> Floats:
        return x - s * _one_sided(w.u, halves) * np.exp(-(((w.u - middle) / 2.5) ** 2))

    return Effect("shape", "asymmetric ceramic", "stage", run, 0.1, 4.0, lambda s: {})


def hum_for_a_third(rng: np.random.Generator, own: bool, dt: float) -> Effect:
    """A machine that runs for a third of each recording."""
    f = float(rng.choice([50.0, 60.0, rng.uniform(0.02, 0.15) / dt]))
    start = rng.uniform(0.15, 0.5)

    def run(x: Floats, w: World, s: float) -> Floats:
        part = w.t / w.during
        on = (part > start) & (part < start + 0.33)
        return x + s * on * np.sin(2 * np.pi * (f * w.t + w.rng(9).random()))

    return Effect("hum", f"{f:.1f} Hz for a third", "reading", run, 0.05, 5.0, lambda s: {})


def slip(rng: np.random.Generator, own: bool, dt: float) -> Effect:
    """The stage slips in its clamp once, at a moment of each recording."""
    at = rng.uniform(0.3, 0.7)

    def run(x: Floats, w: World, s: float) -> Floats:
        return x + s * (w.t > at * w.during)

    return Effect("unknown", "a slip", "stage", run, 0.1, 3.0, lambda s: {})


SHAPES = {
    "asymmetric ceramic": asymmetric,
    "curved sensor": curved_sensor,
    "presliding friction": presliding,
}
PARTED = {"hum for a third": hum_for_a_third, "slip": slip}
