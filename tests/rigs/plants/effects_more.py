"""Effects that stay partly or wholly inside a rate-independent base, and effects of no library.

See `effects` for the form. The second group tests whether the tool reports "unknown" when it
should. Shares no code with the library.
"""

import numpy as np
from numba import njit
from tests.rigs.plants.drives import Floats
from tests.rigs.plants.effects import (
    Effect,
    World,
    clip,
    coupling,
    creep,
    delay,
    drift,
    hum,
    lag,
    low_pass,
    resonance,
    slew,
    warm_up,
)


@njit(cache=True, nogil=True)
def _backlash(x: Floats, half: Floats) -> Floats:
    """A dead band whose half width changes over time; starts in the middle of the band."""
    out = np.empty(x.size)
    p = x[0]
    for t in range(x.size):
        p = max(x[t] - half[t], min(x[t] + half[t], p))
        out[t] = p
    return out


@njit(cache=True, nogil=True)
def bristles(x: Floats, coulomb: float, excess: float, stribeck: float, h: float) -> Floats:
    """LuGre: dz = dx - |dx| z / g(v), g = coulomb + excess exp(-(v / stribeck)^2)."""
    out = np.empty(x.size)
    z = 0.0
    last = x[0]
    for t in range(x.size):
        dx = x[t] - last
        last = x[t]
        g = coulomb + excess * np.exp(-((dx / h / stribeck) ** 2))
        side = g if dx > 0 else -g
        z = side + (z - side) * np.exp(-abs(dx) / g)
        out[t] = z
    return out


def asymmetry(rng: np.random.Generator, own: bool, dt: float) -> Effect:
    half = rng.uniform(0.5, 2.0)

    def run(x: Floats, w: World, s: float) -> Floats:
        ahead = w.u - _backlash(w.u, np.full(w.u.size, half))
        return x + s * np.maximum(ahead, 0.0) ** 2

    return Effect("asymmetry", "one-sided", "stage", run, 0.05, 3.0, lambda s: {})


def friction(rng: np.random.Generator, own: bool, dt: float) -> Effect:
    presliding, stribeck = rng.uniform(0.03, 0.25), rng.uniform(5e-3, 0.06) / dt

    def run(x: Floats, w: World, s: float) -> Floats:
        z = bristles(x, presliding, 0.6 * presliding, stribeck, w.h)
        return x - s * z / presliding - 0.02 * s * np.gradient(x, w.h) / stribeck

    return Effect("friction", "lugre", "stage", run, 0.1, 3.0, lambda s: {})


def sensor(rng: np.random.Generator, own: bool, dt: float) -> Effect:
    period = float(rng.choice([rng.uniform(1.2, 4.0), rng.uniform(8.0, 20.0)]))
    phase = rng.uniform(0, 2 * np.pi)

    def run(x: Floats, w: World, s: float) -> Floats:
        return x + s * (np.sin(2 * np.pi * x / period + phase) - np.sin(phase))

    return Effect("sensor", f"sine of {period:.1f} um", "reading", run, 0.05, 3.0, lambda s: {})


def rate(rng: np.random.Generator, own: bool, dt: float) -> Effect:
    halves = np.linspace(0.1, rng.uniform(0.8, 2.0), 8)
    power, knee = rng.uniform(0.4, 1.0), rng.uniform(0.05, 0.2) / dt

    def run(x: Floats, w: World, s: float) -> Floats:
        speed = low_pass(np.abs(np.gradient(w.u, w.h)), 2.0 * dt, w.h)
        wider = 1.0 + s * (np.maximum(speed, 0.0) / knee) ** power
        return x + sum(
            _backlash(w.u, r * wider) - _backlash(w.u, np.full(w.u.size, r)) for r in halves
        ) / (3.0 * halves.size)

    return Effect("rate", "dilating", "stage", run, 0.3, 20.0, lambda s: {})


def gain_step(rng: np.random.Generator, own: bool, dt: float) -> Effect:
    def run(x: Floats, w: World, s: float) -> Floats:
        r = w.rng(3)
        at = r.uniform(0.35, 0.65) * w.during
        return np.where(w.t < at, x, x * (1.0 + s))

    return Effect("unknown", "gain step", "reading", run, 0.01, 0.5, lambda s: {})


def freezes(rng: np.random.Generator, own: bool, dt: float) -> Effect:
    def run(x: Floats, w: World, s: float) -> Floats:
        r = w.rng(4)
        out = x.copy()
        for start in np.sort(r.uniform(0.5, w.during - 1.0, int(w.during * 0.8))):
            i = int(start / w.h)
            j = i + max(1, int(s * r.uniform(0.5, 1.5) / w.h))
            out[i:j] = out[i]
        return out

    return Effect("unknown", "frozen reading", "reading", run, 0.02, 0.5, lambda s: {})


def spikes(rng: np.random.Generator, own: bool, dt: float) -> Effect:
    def run(x: Floats, w: World, s: float) -> Floats:
        r = w.rng(5)
        hits = np.zeros(x.size)
        where = r.integers(0, x.size, int(8 * w.during))
        hits[where] = r.standard_normal(where.size) * 8.0
        return x + s * low_pass(hits, 2.0 * dt, w.h)

    return Effect("unknown", "bursts of shocks", "reading", run, 0.5, 400.0, lambda s: {})


def loosened(rng: np.random.Generator, own: bool, dt: float) -> Effect:
    def run(x: Floats, w: World, s: float) -> Floats:
        at = w.rng(6).uniform(0.3, 0.6) * w.during
        return _backlash(x, s * (w.t > at))

    return Effect("unknown", "backlash from a moment on", "stage", run, 0.05, 1.5, lambda s: {})


def pops(rng: np.random.Generator, own: bool, dt: float) -> Effect:
    def run(x: Floats, w: World, s: float) -> Floats:
        r = w.rng(7)
        jumps = np.zeros(x.size)
        where = r.integers(0, x.size, max(3, int(0.4 * w.during)))
        np.add.at(jumps, where, r.choice([-1.0, 1.0], where.size) * r.uniform(0.5, 1.5, where.size))
        level = np.cumsum(jumps)
        return x + s * (level - level.mean())

    return Effect("unknown", "sudden offsets", "reading", run, 0.05, 2.0, lambda s: {})


def wandering_line(rng: np.random.Generator, own: bool, dt: float) -> Effect:
    f0 = rng.uniform(0.018, 0.035) / dt

    def run(x: Floats, w: World, s: float) -> Floats:
        r = w.rng(8)
        knots = r.uniform(0.6, 1.5, int(w.during / 1.5) + 2)
        f = f0 * np.interp(w.t, np.arange(knots.size) * 1.5, knots)
        on = np.interp(w.t, np.arange(knots.size) * 1.5, r.permutation(knots) > 0.95)
        return x + s * on * np.sin(2 * np.pi * np.cumsum(f) * w.h)

    return Effect("unknown", "a fan that changes speed", "reading", run, 0.05, 5.0, lambda s: {})


def stuck_after_rest(rng: np.random.Generator, own: bool, dt: float) -> Effect:
    """Bonds grow while the stage rests and break once it has moved half a micrometre."""
    way, grow = rng.uniform(0.2, 0.6), rng.uniform(0.3, 1.0)

    def run(x: Floats, w: World, s: float) -> Floats:
        return x - s * _bonds(x, way, grow, w.h)

    return Effect("unknown", "bonds that grow at rest", "stage", run, 0.2, 5.0, lambda s: {})


@njit(cache=True, nogil=True)
def _bonds(x: Floats, way: float, grow: float, h: float) -> Floats:
    out = np.empty(x.size)
    strength, held = 0.0, x[0]
    last = x[0]
    for t in range(x.size):
        moved = abs(x[t] - last)
        last = x[t]
        if moved / h < 0.5:
            strength += (1.0 - strength) * (1.0 - np.exp(-h / grow))
            held += 0.02 * (x[t] - held) * (1.0 - strength)
        strength *= np.exp(-moved / way)
        held += (x[t] - held) * (1.0 - np.exp(-2.0 * moved / way))
        out[t] = strength * (x[t] - held) * 4.0 + 0.3 * strength
    return out


MAKERS = {
    "creep": creep, "resonance": resonance, "delay": delay, "lag": lag, "slew": slew,
    "clip": clip, "drift": drift, "hum": hum, "coupling": coupling, "rate": rate,
    "sensor": sensor, "friction": friction, "asymmetry": asymmetry, "warm-up": warm_up,
}  # fmt: skip
OUTSIDE = {
    "gain step": gain_step, "freezes": freezes, "spikes": spikes, "loosened": loosened,
    "pops": pops, "wandering line": wandering_line, "stuck after rest": stuck_after_rest,
}  # fmt: skip
