"""Polynomial NARX model with the sign of the drive's change (Martins and Aguirre, Mech. Syst.
Signal Process. 75, 2016): y(k) from y and u at d and 2 d samples before, degree 2.

The weights come from one-step predictions; the spacing d is the one with the smallest free-run
error on the fitted recording.
"""

import math

import numpy as np
from numba import njit

from dehyst.daemon.benchmark.rivals.interface import Predict, Rival, Scale, measured, solve_ridge
from dehyst.models.recording import Floats, Recording

SPACINGS = (1, 2, 4, 8, 16, 32)  # samples
TERMS = 19
DIVERGED = 1e3  # standard deviations


@njit(cache=True)
def regressors(
    u: float, u1: float, u2: float, y1: float, y2: float, sign: float, out: Floats
) -> None:
    """Fill out (TERMS,): 1, linear and quadratic terms, and terms with the sign of the drive's
    change."""
    x = (u, u1, u2, y1, y2)
    out[0] = 1.0
    place = 1
    for i in range(5):
        out[place] = x[i]
        place += 1
    out[place], out[place + 1], out[place + 2] = u * u, u * y1, y1 * y1
    out[place + 3], out[place + 4] = u1 * u1, u1 * y1
    out[place + 5], out[place + 6] = (u - u1) * u, (u - u1) * y1
    place += 7
    out[place], out[place + 1], out[place + 2] = sign, sign * u, sign * y1
    out[place + 3] = sign * (u - u1)
    out[place + 4], out[place + 5] = sign * (u - u1) * u, sign * (u - u1) * y1


@njit(cache=True)
def one_step(d: int, u: Floats, y: Floats) -> Floats:
    """Return (N - 2 d, TERMS) regressors of measured rows."""
    out = np.empty((u.size - 2 * d, TERMS))
    for k in range(2 * d, u.size):
        sign = np.sign(u[k] - u[k - d])
        regressors(u[k], u[k - d], u[k - 2 * d], y[k - d], y[k - 2 * d], sign, out[k - 2 * d])
    return out


@njit(cache=True)
def free_run(d: int, weights: Floats, u: Floats, rest: float) -> Floats:
    """Return (N,) outputs predicted from the model's own outputs; rest: output before the first
    sample, where the drive was u[0]."""
    y, row = np.empty(u.size), np.empty(TERMS)
    for k in range(u.size):
        y1 = y[k - d] if k >= d else rest
        y2 = y[k - 2 * d] if k >= 2 * d else rest
        u1, u2 = u[max(0, k - d)], u[max(0, k - 2 * d)]
        regressors(u[k], u1, u2, y1, y2, np.sign(u[k] - u1), row)
        value = 0.0
        for j in range(TERMS):
            value += weights[j] * row[j]
        if not abs(value) < DIVERGED:
            y[k:] = math.inf
            break
        y[k] = value
    return y


def fit_narx(recording: Recording) -> Predict:
    """Fit every spacing, and keep the one with the smallest free-run error."""
    scale = Scale.of(recording)
    u, y = scale.drive(recording.drive), scale.displacement(measured(recording))
    best, least = (0, np.zeros(0)), math.inf
    for d in SPACINGS:
        if u.size <= 2 * d + TERMS:
            continue
        weights = solve_ridge(one_step(d, u, y), y[2 * d :])
        error = float(np.mean((free_run(d, weights, u, float(y[0])) - y) ** 2))
        if error < least or not best[0]:
            best, least = (d, weights), error
    d, weights = best
    rest = float(y[0])
    return lambda t_s, u: scale.back(free_run(d, weights, scale.drive(u), rest))


NARX = Rival(
    "NARX", fit_narx, "by iteration", "Martins and Aguirre, Mech. Syst. Signal Process. 75, 2016"
)
