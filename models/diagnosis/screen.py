"""A candidate's promise from each of its starts, cheaply: its first-order effect with the whole
base refitted (projection off every fitted column), without nonlinear refits."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from dehyst.models.diagnosis.candidates.interface import Candidate, Context
from dehyst.models.diagnosis.data import Floats
from dehyst.models.diagnosis.fit import Effect, Fitted, Problem, drive_behind, in_order


def screen(
    problem: Problem, current: Fitted, candidate: Candidate, tangent: Floats
) -> list[tuple[float, tuple[float, ...]]]:
    """(estimated fall of the sum of squares, start) for every start, best first.

    tangent: (rows, p) orthonormal directions in which the accepted effects' own parameters move
    the prediction; they are projected off too. Only the right sign counts: a delay that would have to be negative gains nothing.
    """
    data = problem.data
    residual = current.residual(data)
    r = problem.counted(residual)
    out = problem.output_of(current)
    v = drive_behind(data, current.effects)
    scores = []
    for theta in candidate.starts(data, residual):
        if candidate.mode == "columns":
            x = candidate.columns(data, Context(v, out), theta)
        else:
            effects = in_order([*current.effects, Effect(candidate, tuple(theta))])
            x = (_with(problem, current, effects, out) - current.prediction)[:, None]
        xp = problem.counted(problem.project(current, x))
        xp = xp - tangent @ (tangent.T @ xp)
        a, g = xp.T @ xp, xp.T @ r
        if candidate.mode != "columns":
            gain = float(g[0] ** 2 / a[0, 0]) if a[0, 0] > 0 and g[0] > 0 else 0.0
            if gain > 0:
                theta = candidate.scaled(theta, float(g[0] / a[0, 0]))
        else:
            gain = float(g @ np.linalg.pinv(a, rcond=1e-10, hermitian=True) @ g)
        scores.append((gain, tuple(theta)))
    scores.sort(key=lambda s: -s[0])
    return scores


def tangent_of(problem: Problem, current: Fitted) -> Floats:
    """Orthonormal basis (rows, p) of the accepted effects' nonlinear directions."""
    if not any(e.theta for e in current.effects):
        return np.zeros((int(problem.data.rows.sum()), 0))
    _, jac = problem.jacobian(current, problem.output_of(current))
    projected = problem.counted(problem.project(current, jac))
    norms = np.sqrt(np.sum(projected**2, axis=0))
    projected = projected[:, norms > 1e-9 * max(float(norms.max()), 1e-30)]
    q, _ = np.linalg.qr(projected)
    return q


def _with(problem: Problem, current: Fitted, effects: Sequence[Effect], out: Floats) -> Floats:
    """Prediction with the current weights and one more effect (its additive part absent)."""
    known = {e.candidate.key: a for e, a in zip(current.effects, current.amplitudes, strict=True)}
    amplitudes = tuple(known.get(e.candidate.key, np.zeros(0)) for e in effects)
    return problem.simulate(replace(current, amplitudes=amplitudes), effects, out)
