"""Differential models in the drive: Bouc-Wen and Duhem.

Bouc-Wen, normalised (Ikhouane and Rodellar, Systems with Hysteresis, 2007), y = c0 + c1 u + c2 h:

    dh = rho [1 - |h|^n (1 - sigma + sigma sgn(du h))] du

Duhem in the form of Coleman and Hodgdon (Int. J. Eng. Sci. 24, 1986):

    dy = alpha |du| [f(u) - y] + g(u) du,   f and g polynomials, which are linear in the fit
"""

import math

import numpy as np
import scipy.optimize
from numba import njit

from dehyst.daemon.benchmark.rivals.interface import Predict, Rival, Scale, measured, solve_ridge
from dehyst.models.recording import Floats, Recording

STEP = 0.05  # largest change of h in one integration step
STARTS = ((1.0, 0.7, 1.0), (4.0, 0.7, 1.0), (12.0, 0.7, 1.0))  # rho, sigma, n
LOW, HIGH = (math.log(0.1), 0.5, 1.0), (math.log(100.0), 1.0, 4.0)
DEGREE = 3  # of f and g
ALPHAS = (0.05, 100.0)  # 1 / range of the drive


@njit(cache=True)
def bouc_wen(rho: float, sigma: float, n: float, u: Floats) -> Floats:
    """Return the (N,) hysteretic variable, 0 before the first sample at drive 0."""
    out = np.empty(u.size)
    h, before = 0.0, 0.0
    for t in range(u.size):
        du = u[t] - before
        parts = max(1, math.ceil(rho * abs(du) / STEP))
        for _ in range(parts):
            sign = 1.0 if du * h >= 0.0 else -1.0
            h += rho * (1.0 - abs(h) ** n * (1.0 - sigma + sigma * sign)) * du / parts
        out[t] = h
        before = u[t]
    return out


def fit_bouc_wen(recording: Recording) -> Predict:
    """Fit three parameters by bounded least squares from several starts; solve for the others
    inside."""
    scale = Scale.of(recording)
    u, y = scale.drive(recording.drive), scale.displacement(measured(recording))

    def columns(p: Floats, u: Floats) -> Floats:
        return np.stack([np.ones(u.size), u, bouc_wen(math.exp(p[0]), p[1], p[2], u)], axis=1)

    def left(p: Floats) -> Floats:
        x = columns(p, u)
        return np.asarray(x @ solve_ridge(x, y) - y)

    found = [
        scipy.optimize.least_squares(
            left, (math.log(rho), sigma, n + 0.1), bounds=(LOW, HIGH), max_nfev=60
        )
        for rho, sigma, n in STARTS
    ]
    p = min(found, key=lambda one: one.cost).x
    weights = solve_ridge(columns(p, u), y)
    return lambda t_s, u: scale.back(columns(p, scale.drive(u)) @ weights)


@njit(cache=True)
def duhem_columns(alpha: float, degree: int, u: Floats) -> Floats:
    """Return (N, 2 degree) responses of dy = alpha |du| (f - y) + g du to f = u, u^2, ... and g =
    1, u, ..., exact while f and g are constant over a step; 0 before the first sample at drive
    0."""
    out = np.empty((u.size, 2 * degree))
    state, before = np.zeros(2 * degree), 0.0
    for t in range(u.size):
        du, middle = u[t] - before, 0.5 * (u[t] + before)
        keep = math.exp(-alpha * abs(du))
        way = (1.0 - keep) / alpha if alpha * abs(du) > 1e-12 else abs(du)
        power = 1.0
        for j in range(degree):
            state[degree + j] = state[degree + j] * keep + power * math.copysign(way, du)
            power *= middle
            state[j] = power + (state[j] - power) * keep
        out[t] = state
        before = u[t]
    return out


def fit_duhem(recording: Recording) -> Predict:
    """Fit alpha by a search over decades; solve for the polynomials inside."""
    scale = Scale.of(recording)
    u, y = scale.drive(recording.drive), scale.displacement(measured(recording))

    def columns(log_alpha: float, u: Floats) -> Floats:
        return np.hstack([np.ones((u.size, 1)), duhem_columns(math.exp(log_alpha), DEGREE, u)])

    def cost(log_alpha: float) -> float:
        x = columns(log_alpha, u)
        return float(np.mean((x @ solve_ridge(x, y) - y) ** 2))

    grid = np.log(np.geomspace(*ALPHAS, 12))
    best = int(np.argmin([cost(at) for at in grid]))
    around = (float(grid[max(0, best - 1)]), float(grid[min(grid.size - 1, best + 1)]))
    at = float(scipy.optimize.minimize_scalar(cost, bounds=around, method="bounded").x)
    weights = solve_ridge(columns(at, u), y)
    return lambda t_s, u: scale.back(columns(at, scale.drive(u)) @ weights)


BOUC_WEN = Rival("Bouc-Wen", fit_bouc_wen, "by iteration", "Wen, J. Eng. Mech. 102, 1976")
DUHEM = Rival("Duhem", fit_duhem, "by iteration", "Coleman and Hodgdon, Int. J. Eng. Sci. 24, 1986")
