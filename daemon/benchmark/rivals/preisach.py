"""Preisach model on a discretised plane.

y = c + sum_ij mu_ij gamma_ij(u): relays that switch up at alpha_i and down at beta_j <= alpha_i, on
a grid of CELLS levels, mu_ij >= 0 (Mayergoyz, Mathematical Models of Hysteresis, 1991).
"""

import numpy as np
from numba import njit

from dehyst.daemon.benchmark.rivals.interface import (
    Predict,
    Rival,
    Scale,
    measured,
    solve_not_negative,
)
from dehyst.models.recording import Floats, Recording

CELLS = 24  # levels of the plane: 300 relays
ROWS = 6000  # longer recordings are thinned evenly to at most so many rows: each has 300 columns


@njit(cache=True)
def relay_matrix(up: Floats, down: Floats, u: Floats) -> Floats:
    """Return (N, m) outputs, 0 or 1, of m relays that are all down before the first sample."""
    out = np.zeros((u.size, up.size))
    for i in range(up.size):
        state = 0.0
        for t in range(u.size):
            if u[t] >= up[i]:
                state = 1.0
            elif u[t] <= down[i]:
                state = 0.0
            out[t, i] = state
    return out


@njit(cache=True)
def relay_sum(up: Floats, down: Floats, weights: Floats, u: Floats) -> Floats:
    """Return the (N,) weighted sum of the same relays."""
    out = np.zeros(u.size)
    for i in range(up.size):
        state = 0.0
        for t in range(u.size):
            if u[t] >= up[i]:
                state = weights[i]
            elif u[t] <= down[i]:
                state = 0.0
            out[t] += state
    return out


def plane() -> tuple[Floats, Floats]:
    """Return (m,) switching levels up and down of the relays: the centres of the cells of the half
    plane."""
    level = (np.arange(CELLS) + 0.5) / CELLS
    i, j = np.tril_indices(CELLS)
    return level[i] + 1e-9, level[j] - 1e-9  # a relay on the diagonal has no width


def fit_preisach(recording: Recording) -> Predict:
    """Fit the weights by least squares, none below 0; drop those of value 0."""
    scale, (up, down) = Scale.of(recording), plane()
    columns = relay_matrix(up, down, scale.drive(recording.drive))
    every = -(-columns.shape[0] // ROWS)
    y = scale.displacement(measured(recording))
    weights, offset = solve_not_negative(columns[::every], y[::every])
    kept = weights > 0.0
    up, down, weights = up[kept], down[kept], weights[kept]
    return lambda t_s, u: scale.back(relay_sum(up, down, weights, scale.drive(u)) + offset)


PREISACH = Rival(
    "Preisach plane",
    fit_preisach,
    "by iteration",
    "Mayergoyz, Mathematical Models of Hysteresis, 1991",
)
