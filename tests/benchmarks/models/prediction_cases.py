"""Stages, drives and recordings for the prediction benchmark; none of them uses the product's
forward model as the truth."""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numba import njit
from scipy.optimize import nnls

from dehyst.models.modelfile import shipped
from dehyst.models.recording import Floats, Recording

T_S = 1e-3


@njit(cache=True)
def _plays(r: Floats, u: Floats) -> Floats:
    out, h = np.empty((u.size, r.size)), np.zeros(r.size)
    for t in range(u.size):
        for i in range(r.size):
            h[i] = max(u[t] - r[i], min(u[t] + r[i], h[i]))
            out[t, i] = h[i]
    return out


@dataclass(frozen=True)
class Truth:
    """Eq. 6 written out. r, b, k: (n,); c: ascending powers; central: the rate is the central
    difference, as for a stage in continuous time, instead of the difference to the previous
    sample."""

    r: Floats
    b: Floats
    k: Floats
    c: Floats
    central: bool = False

    def run(self, u: Floats, period_s: float = T_S) -> Floats:
        """Return (N,) the displacement of a stage that is de-energised before the first sample."""
        if self.central:
            rate = np.gradient(u, period_s)
            rate[0] = 0.0
        else:
            rate = np.diff(u, prepend=u[0]) / period_s
        plays = _plays(self.r, u)
        z = plays @ self.b + rate * (plays @ self.k)
        return np.polynomial.polynomial.polyval(z, self.c)

    def stretched(self, factor: float) -> "Truth":
        """Return the same stage with a drive range that is `factor` times as wide."""
        return Truth(self.r * factor, self.b / factor, self.k / factor**2, self.c, self.central)


def paper(central: bool = False) -> Truth:
    """Eq. 12."""
    h = shipped("paper-eq12").hysteresis
    return Truth(np.array(h.r), np.array(h.b), np.array(h.k), np.array(h.c), central)


def smooth(rate: bool = False) -> Truth:
    """A stage of 90 operators with falling weights; with rate: its loops widen with the rate, and
    it can be inverted. For a drive from 0 to 10 V and rates up to about 200 V/s."""
    r = np.linspace(0.0, 9.0, 90)
    b = np.r_[0.75, 0.012 * np.exp(-r[1:] / 2.5)]
    k = np.r_[-9e-4, 2.2e-5 * np.exp(-r[1:] / 1.5)] if rate else np.zeros(r.size)
    return Truth(r, b, k, np.array([0.0, 1.0, 0.0, -2e-4]))


def preisach(u: Floats) -> Floats:
    """Return (N,) a stage of another class without rate-dependence: a straight line and a Preisach
    plane of relays whose density is not symmetric, about 10 um for 0 to 10 V."""
    grid = np.linspace(0.0, 10.0, 121)
    up, down = np.meshgrid(grid, grid, indexing="ij")
    inside = up > down
    up, down = up[inside], down[inside]
    weight = np.exp(-(up - down) / 3.0) * (1.0 + 0.05 * (up + down))
    return 0.75 * u + _relays(up, down, 2.5 * weight / weight.sum(), u)


@njit(cache=True)
def _relays(up: Floats, down: Floats, weight: Floats, u: Floats) -> Floats:
    on, y = np.zeros(up.size), np.empty(u.size)
    for t in range(u.size):
        for i in range(up.size):
            if u[t] >= up[i]:
                on[i] = 1.0
            elif u[t] <= down[i]:
                on[i] = 0.0
        y[t] = np.dot(weight, on)
    return y


def times(seconds: float, period_s: float = T_S) -> Floats:
    """Return (N,) regular stamps."""
    return np.arange(round(seconds / period_s)) * period_s


def sines(t: Floats, *parts: tuple[float, float]) -> Floats:
    """Return Eq. 9, offset so that it starts at 0; parts: (amplitude, frequency Hz)."""
    return sum(a * (1.0 - np.cos(2 * np.pi * f * t)) for a, f in parts)


def triangle(t: Floats, low: float, high: float, f: float = 1.0) -> Floats:
    """Return a triangle from low to high and back."""
    phase = (t * f) % 1.0
    return low + (high - low) * (1.0 - np.abs(2.0 * phase - 1.0))


def sweep(t: Floats, low: float, high: float, f0: float = 0.1, f1: float = 20.0) -> Floats:
    """Return a sweep, linear in time, from f0 to f1 over all of t."""
    seconds = t.size * (t[1] - t[0])
    phase = 2 * np.pi * (f0 * t + (f1 - f0) / (2 * seconds) * t**2)
    return 0.5 * (low + high) - 0.5 * (high - low) * np.cos(phase)


def multisine(t: Floats, low: float, high: float, seed: int = 5) -> Floats:
    """Return seven sines with random phases, scaled to the range, with an approach from `low`."""
    rng = np.random.default_rng(seed)
    f = np.array([0.7, 1.3, 2.1, 3.7, 5.3, 7.9, 9.7])
    x = (np.sin(2 * np.pi * np.outer(t, f) + rng.uniform(0, 2 * np.pi, 7)) / f**0.3).sum(1)
    x = (x - x.min()) / np.ptp(x) * np.minimum(1.0, t / 0.2)
    return low + (high - low) * x


def record(
    run: Callable[[Floats], Floats], u: Floats, noise: float, seed: int, period_s: float = T_S
) -> Recording:
    """Return a recording with white noise on the displacement."""
    y = run(u) + noise * np.random.default_rng(seed).standard_normal(u.size)
    return Recording(np.arange(u.size) * period_s, u, y, name=f"seed-{seed}.csv")


def begin_late(rec: Recording, rows: int) -> Recording:
    """Return the same recording without its first rows."""
    t = rec.t_s[rows:] - rec.t_s[rows]
    assert rec.displacement is not None
    return Recording(t, rec.drive[rows:], rec.displacement[rows:], name=rec.name)


def fit_peer(rec: Recording) -> Callable[[Floats], Floats]:
    """Fit as a careful user does by hand: 40 uniform thresholds up to the span, non-negative
    weights, a light ridge, no constant (the offset is known to be 0)."""
    y = rec.displacement
    assert y is not None
    r = np.arange(40) / 40 * np.ptp(rec.drive)
    plays = _plays(r, rec.drive)
    light = 1e-3 * np.sqrt(np.mean(plays**2) * y.size) * np.eye(40)
    weights, _ = nnls(np.vstack([plays, light]), np.r_[y, np.zeros(40)])
    return lambda u: _plays(r, u) @ weights


def rms(x: Floats) -> float:
    """Return the root mean square."""
    return float(np.sqrt(np.mean(np.square(x))))
