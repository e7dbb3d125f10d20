"""The augmented model: a joint fit written as hysteresis and blocks of the model file.

The hysteresis is the compact monotone one (non-negative play weights, for the inverse); a shape
block carries what the rich base knows beyond it; the accepted effects are the other blocks.
"""

import numpy as np
from scipy.optimize import nnls

from dehyst.models.diagnosis.data import Floats
from dehyst.models.diagnosis.fit import Fitted, Problem, drive_behind
from dehyst.models.diagnosis.kernels import plays
from dehyst.models.model import Block, Hysteresis, Model, Validity


def compact(problem: Problem, fitted: Fitted) -> Hysteresis:
    """Monotone static model nearest to a fit's hysteresis output: play weights >= 0."""
    data, base = problem.data, problem.base
    v = drive_behind(data, fitted.effects)
    r = base.thresholds * base.span
    h = plays(r, v - base.low, data.starts)
    target = base.columns(v, data.starts) @ fitted.weights
    mean_h, mean_y = h.mean(axis=0), float(target.mean())
    a = h - mean_h
    gram = a.T @ a
    factor = np.linalg.cholesky(gram + 1e-9 * np.trace(gram) * np.eye(r.size))
    sign = 1.0 if float(a[:, 0] @ (target - mean_y)) >= 0 else -1.0
    b, _ = nnls(factor.T, np.linalg.solve(factor, sign * (a.T @ (target - mean_y))))
    b[0] = max(b[0], 1e-3 * float(b.sum()))
    b *= sign
    c0 = mean_y - float(mean_h @ b) + float(fitted.offsets.mean())
    return Hysteresis(r=r, b=b, c=[c0, 1.0], u_offset=base.low)


def augmented(problem: Problem, fitted: Fitted, hysteresis: Hysteresis) -> Model:
    """Model with the shape and the effects as blocks."""
    data = problem.data
    blocks = [_shape(problem, fitted, hysteresis)]
    for effect, amplitudes in zip(fitted.effects, fitted.amplitudes, strict=True):
        blocks.extend(effect.candidate.blocks(effect.theta, amplitudes, data))
    rank = {"drive": 0, "stage": 1, "sensor": 2}
    blocks.sort(key=lambda b: rank[b.place] if b.kind != "shape" else 0.5)
    rate = np.abs(np.diff(data.u)) / data.dt[1:]
    rate = rate[~data.starts[1:]]
    validity = Validity(
        data.u_min,
        data.u_min + data.span,
        rate_max=float(rate.max()) if rate.size and rate.max() > 0 else None,
        period_s=data.period,
    )
    return Model(hysteresis, validity, data.drive_unit, data.unit, tuple(blocks))


def _shape(problem: Problem, fitted: Fitted, hysteresis: Hysteresis) -> Block:
    """The rich base less the compact hysteresis, in plays from 0 upwards.

    The rich base's columns are powers of h = H - 1 with H the play of the drive scaled to 0..2;
    powers of H follow by the binomial rule, constants go into the model's offset.
    """
    base, w = problem.base, fitted.weights
    n = base.thresholds.size
    w1, w2, w3 = w[:n], w[n : 2 * n], w[2 * n : 3 * n]
    half = 0.5 * base.span
    # a (H - 1) + b (H - 1)^2 + c (H - 1)^3
    e1 = w1 - 2 * w2 + 3 * w3 - hysteresis.b * half
    e2 = w2 - 3 * w3
    params: dict[str, float | tuple[float, ...]] = {
        "thresholds_v": _tuple(base.thresholds * base.span),
        "weights_1": _tuple(e1),
        "weights_2": _tuple(e2),
        "weights_3": _tuple(w3),
        "scale_v": half,
        "center_v": base.low,
    }
    return Block("shape", "stage", params)


def _tuple(x: Floats) -> tuple[float, ...]:
    return tuple(float(v) for v in x)
