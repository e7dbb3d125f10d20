"""The augmented model: a joint fit written as hysteresis and blocks of the model file.

The hysteresis is the compact monotone one (non-negative play weights, for the inverse); a shape
block carries what the rich base knows beyond it; the accepted effects are the other blocks.
"""

from dataclasses import replace
from math import comb

import numpy as np
from scipy.optimize import nnls

from dehyst.models.diagnosis.effects import behind_output, drive_behind
from dehyst.models.diagnosis.fit import JointFit, Problem
from dehyst.models.model import Block, Hysteresis, Model, Validity
from dehyst.models.physics import KINDS, DriveScale, bent_loops, curved_plays
from dehyst.models.signals.filters import plays


def compact(problem: Problem, fitted: JointFit) -> Hysteresis:
    """Monotone static model nearest to a fit's hysteresis output: play weights >= 0."""
    data, base = problem.data, problem.base
    v = drive_behind(data, fitted.effects)
    r = base.thresholds * base.span
    h = plays(r, v - base.low, data.starts)
    target = base.combine(v, data.starts, fitted.weights)
    mean_h, mean_y = h.mean(axis=0), float(target.mean())
    a = h - mean_h
    gram = a.T @ a
    factor = np.linalg.cholesky(gram + 1e-9 * np.trace(gram) * np.eye(r.size))
    sign = 1.0 if float(a[:, 0] @ (target - mean_y)) >= 0 else -1.0
    b, _ = nnls(factor.T, np.linalg.solve(factor, sign * (a.T @ (target - mean_y))))
    b[0] = max(b[0], 1e-3 * float(b.sum()))
    b *= sign
    settled = behind_output(data, fitted.effects, np.ones((data.n, 1)))[0, 0]  # their gain at rest
    c0 = mean_y - float(mean_h @ b) + float(fitted.offsets.mean()) / settled
    return Hysteresis(r=r, b=b, c=np.array([c0, 1.0]), u_offset=base.low)


def augmented(problem: Problem, fitted: JointFit, hysteresis: Hysteresis) -> Model:
    """Model with the shape and the effects as blocks."""
    data = problem.data
    shape, constant = _shape(problem, fitted, hysteresis)
    settled = behind_output(data, fitted.effects, np.ones((data.n, 1)))[0, 0]
    c0 = constant + float(fitted.offsets.mean()) / settled
    hysteresis = replace(hysteresis, c=np.array([c0, 1.0]))
    blocks = [shape, _memory(problem, fitted)]
    for effect, amplitudes in zip(fitted.effects, fitted.amplitudes, strict=True):
        blocks.extend(effect.candidate.blocks(effect.theta, amplitudes, data))
    rank = {"drive": 0, "stage": 1, "sensor": 2}
    blocks.sort(key=lambda b: 0.5 if KINDS[b.kind].beside else rank[b.place])
    rate = np.abs(np.diff(data.u)) / data.dt[1:]
    rate = rate[~data.starts[1:]]
    validity = Validity(
        data.u_min,
        data.u_min + data.span,
        rate_max=float(rate.max()) if rate.size and rate.max() > 0 else None,
        period_s=data.period,
    )
    return Model(hysteresis, validity, data.drive_unit, data.unit, tuple(blocks))


def _shape(problem: Problem, fitted: JointFit, hysteresis: Hysteresis) -> tuple[Block, float]:
    """The rich base less the compact hysteresis, in plays from 0 upwards.

    The rich base's columns are powers of h = H - 1 with H the play of the drive scaled to 0..2;
    powers of H follow by the binomial rule; returns the block and the constant that is left.
    """
    base = problem.base
    w = base.full(fitted.weights)
    n = base.thresholds.size
    half = 0.5 * base.span
    powers = w[: 5 * n].reshape(5, n)  # of h, from the first
    e = np.zeros((6, n))
    for power in range(1, 6):
        for k in range(power + 1):
            e[k] += comb(power, k) * (-1.0) ** (power - k) * powers[power - 1]
    e[1] -= hysteresis.b * half
    scale = DriveScale(base.low, half, problem.data.drive_unit)
    return curved_plays(base.thresholds * base.span, e[1:], scale), float(np.sum(e[0]))


def _memory(problem: Problem, fitted: JointFit) -> Block:
    """The Dahl columns and the high powers of the rich base; their order is the base's."""
    base = problem.base
    m = base.lengths.size
    w = base.full(fitted.weights)[5 * base.thresholds.size :]
    z, zx, zz, zxx, zzz = w[: 5 * m].reshape(5, m)
    half = 0.5 * base.span
    scale = DriveScale(base.low + half, half, problem.data.drive_unit)
    weights = np.stack([z, zx, zxx, zz, zzz])
    return bent_loops(base.lengths * base.span, weights, w[5 * m : 5 * m + 2], scale)
