"""Drives of the paper, recordings made with them, and other methods of identification."""

from dataclasses import dataclass

import numpy as np
from numba import njit
from scipy.optimize import least_squares, nnls

from dehyst.models.hysteresis.forward import simulate_hysteresis
from dehyst.models.hysteresis.play import play_matrix
from dehyst.models.model import Hysteresis
from dehyst.models.recording import Floats, Recording

T_S = 1e-3
PAPER_BOUND = 10.0  # V, upper limit of the paper's input range


def times(seconds: float) -> Floats:
    """Return (N,) stamps every millisecond."""
    return np.arange(round(seconds / T_S)) * T_S


def sines(t: Floats, *parts: tuple[float, float], middle: float | None = None) -> Floats:
    """Return Eq. 9, offset so that it starts at 0 V; parts: (amplitude V, frequency Hz)."""
    middle = sum(a for a, _ in parts) if middle is None else middle
    return middle + sum(a * np.sin(2 * np.pi * f * t - np.pi / 2) for a, f in parts)


def two_sines(seconds: float = 10.0) -> Floats:
    """Return the paper's identification drive, 10 V peak to peak."""
    return sines(times(seconds), (2, 10), (3, 5))


def four_sines(seconds: float = 10.0) -> Floats:
    """Return the paper's verification drive."""
    return sines(times(seconds), (1, 10), (1, 7.5), (1, 5), (2, 4))


def triangle(top: float, seconds: float = 10.0) -> Floats:
    """Return a triangle of 1 Hz, 0 to top."""
    phase = times(seconds) % 1.0
    return top * (1.0 - np.abs(2.0 * phase - 1.0))


def sweep(low: float, high: float, seconds: float = 20.0) -> Floats:
    """Return a sweep from 0.1 to 20 Hz, linear in time."""
    t = times(seconds)
    phase = 2 * np.pi * (0.1 * t + (20 - 0.1) / (2 * seconds) * t**2)
    return 0.5 * (low + high) - 0.5 * (high - low) * np.cos(phase)


def recording(u: Floats, truth: Hysteresis, noise_um: float, seed: int) -> Recording:
    """Return what a perfect rig with white sensor noise records of a stage that equals `truth`."""
    y = simulate_hysteresis(truth, u, T_S) + noise_um * np.random.default_rng(seed).standard_normal(
        u.size
    )
    return Recording(np.arange(u.size) * T_S, u, y, name="two-sines.csv")


def rms(x: Floats) -> float:
    """Return the root mean square."""
    return float(np.sqrt(np.mean(np.square(x))))


@dataclass(frozen=True)
class PaperFit:
    """Result of the paper's method: rms, seconds, forward runs."""

    rms: float
    forward_runs: int


def paper_way(rec: Recording, compiled: bool, most_runs: int) -> PaperFit:
    """Fit all 33 parameters of Eq. 6 at once by a general solver with finite differences.

    Start: cubic thresholds (Eq. 10), equal weights, no saturation, because the paper gives no
    other. compiled: the forward model in numba instead of numpy.
    """
    n, y = 10, rec.displacement
    assert y is not None
    u = rec.drive
    rate = np.diff(u, prepend=u[0]) / T_S
    gain = float(np.ptp(y) / np.ptp(u))
    start = np.concatenate(
        [
            (np.arange(1, n + 1) / n) ** 3 * PAPER_BOUND / 2,
            np.zeros(n),
            np.full(n, gain / n),
            [1.0, 0.0, 0.0],
        ]
    )
    scale = np.concatenate([np.full(n, 1.0), np.full(n, 1e-4), np.full(n, 0.1), [1.0, 0.01, 1e-4]])
    forward = _forward_compiled if compiled else _forward_numpy
    runs = 0

    def residual(p: Floats) -> Floats:
        nonlocal runs
        runs += 1
        return forward(p, u, rate, n) - y

    found = least_squares(residual, start, x_scale=scale, max_nfev=most_runs)
    return PaperFit(rms(found.fun), runs)


def _forward_numpy(p: Floats, u: Floats, rate: Floats, n: int) -> Floats:
    r, k, b, c = np.abs(p[:n]), p[n : 2 * n], p[2 * n : 3 * n], p[3 * n :]
    h = np.zeros(n)
    plays = np.empty((u.size, n))
    for t in range(u.size):
        h = np.maximum(u[t] - r, np.minimum(u[t] + r, h))
        plays[t] = h
    z = plays @ b + rate * (plays @ k)
    return c[0] * z + c[1] * z**3 + c[2] * z**5


@njit(cache=True)
def _forward_compiled(p: Floats, u: Floats, rate: Floats, n: int) -> Floats:
    h = np.zeros(n)
    y = np.empty(u.size)
    for t in range(u.size):
        z = 0.0
        for i in range(n):
            r = abs(p[i])
            h[i] = max(u[t] - r, min(u[t] + r, h[i]))
            z += (p[2 * n + i] + p[n + i] * rate[t]) * h[i]
        y[t] = p[3 * n] * z + p[3 * n + 1] * z**3 + p[3 * n + 2] * z**5
    return y


def uniform_pi(rec: Recording, fitted: int) -> Floats:
    """Return (N,) the prediction of ten operators with uniform thresholds and weights by
    non-negative least squares on the first `fitted` rows, as found in public code."""
    u, y = rec.drive, rec.displacement
    assert y is not None
    r = np.arange(10) / 10 * np.ptp(u[:fitted]) / 2
    plays = play_matrix(r, u - u[0], np.zeros(10))
    columns = np.column_stack([plays, np.ones(u.size), -np.ones(u.size)])
    weights, _ = nnls(columns[:fitted], y[:fitted])
    return columns @ weights
