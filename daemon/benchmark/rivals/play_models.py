"""Prandtl-Ishlinskii models: this project's, and the classical one.

Classical: y = c + sum_i w_i H_ri(u), r_i evenly spaced up to half the range, w_i >= 0
(Krasnosel'skii and Pokrovskii, Systems with Hysteresis, 1989; Kuhnen, Eur. J. Control 2003).
"""

import numpy as np

from dehyst.daemon.benchmark.rivals.interface import (
    Predict,
    Rival,
    Scale,
    measured,
    solve_not_negative,
)
from dehyst.models.cascade.simulate import simulate
from dehyst.models.hysteresis.play import play_matrix
from dehyst.models.identify import Options, identify_alone
from dehyst.models.recording import Floats, Recording

OPERATORS = 20  # thresholds of the classical model
THRESHOLDS = 0.5 * np.arange(OPERATORS) / OPERATORS  # of the range; one of half of it never moves


def fit_this(recording: Recording) -> Predict:
    """Fit this project's modified model with its linear dynamics, as `dehyst identify` does."""
    model = identify_alone([recording], Options()).model
    return lambda t_s, u: simulate(model, t_s, u)


def fit_classical(recording: Recording) -> Predict:
    """Fit the weights by least squares, none below 0."""
    scale = Scale.of(recording)

    def columns(u: Floats) -> Floats:
        return play_matrix(THRESHOLDS, scale.drive(u), np.zeros(OPERATORS))

    y = scale.displacement(measured(recording))
    weights, offset = solve_not_negative(columns(recording.drive), y)
    return lambda t_s, u: scale.back(columns(u) @ weights + offset)


THIS = Rival(
    "this project",
    fit_this,
    "yes, exactly and sample by sample",
    "modified Prandtl-Ishlinskii with lag, Qin et al. 2017",
)
CLASSICAL = Rival(
    "classical PI",
    fit_classical,
    "yes, in closed form",
    "Kuhnen, Eur. J. Control 9, 2003",
)
