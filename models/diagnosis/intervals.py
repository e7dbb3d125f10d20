"""95 % intervals of the parameters of a joint fit.

White noise alone would give intervals far too narrow when the base leaves an error of its own,
so the spread between time blocks counts: the delete-one-block jackknife (B. Efron, C. Stein,
Ann. Stat. 9, 1981), in its one-step Gauss-Newton form. The wider of the two holds.
"""

import numpy as np

from dehyst.models.diagnosis.data import Floats
from dehyst.models.diagnosis.fit import Effect, Fitted, Problem, internal, moved
from dehyst.models.diagnosis.result import Value

WIDTH = 2.5  # Student's t for about a dozen blocks is 2.2; the jackknife's own error adds


def intervals(problem: Problem, fitted: Fitted, sigma: float) -> list[dict[str, Value]]:
    """For each effect of the fit, in order: parameter key -> value with its interval."""
    if not fitted.effects:
        return []
    cov = _covariance(problem, fitted, sigma)
    p = internal(fitted.effects)
    out = []
    theta_at, amplitude_at = 0, p.size
    for i, effect in enumerate(fitted.effects):
        amplitudes = fitted.amplitudes[i]
        at = [
            *range(theta_at, theta_at + len(effect.theta)),
            *range(amplitude_at, amplitude_at + amplitudes.size),
        ]
        theta_at += len(effect.theta)
        amplitude_at += amplitudes.size
        out.append(_values(fitted, i, p, cov[np.ix_(at, at)]))
    return out


def _values(fitted: Fitted, index: int, p: Floats, cov: Floats) -> dict[str, Value]:
    """Reported values of one effect; their intervals by differences through what it reports."""
    effect, amplitudes = fitted.effects[index], fitted.amplitudes[index]
    best = effect.candidate.values(effect.theta, amplitudes)
    count = len(effect.theta)
    own = internal([effect])
    gradient: dict[str, list[float]] = {key: [] for key in best}
    sure = {p.key: p.sure for p in effect.parameters}
    log = {key: value > 0 for key, (value, _) in best.items()}
    for j in range(cov.shape[0]):
        size = max(float(np.sqrt(cov[j, j])), 1e-12)
        step = min(0.1 * size, 1e-2) if j < count else 0.1 * size
        theta, amps = effect.theta, np.array(amplitudes)
        if j < count:
            theta = _stepped(effect, own, j, step)
            actual = internal([Effect(effect.candidate, theta)])[j] - own[j]
            if abs(actual) < 0.5 * step:
                theta = _stepped(effect, own, j, -step)
                actual = internal([Effect(effect.candidate, theta)])[j] - own[j]
            step = actual
        else:
            amps[j - count] += step
        other = effect.candidate.values(theta, amps)
        for key, (value, _) in best.items():
            there = other.get(key, (value, ""))[0]
            both = log[key] and there > 0
            change = np.log(there / value) if both else there - value
            gradient[key].append(float(change) / step if step else 0.0)
    out = {}
    for key, (value, unit) in best.items():
        g = np.array(gradient[key])
        half = WIDTH * float(np.sqrt(max(g @ cov @ g, 0.0)))
        half = max(half, sure.get(key, 0.0) * (1.0 if log[key] else abs(value)))
        if log[key]:
            half = min(half, 20.0)
            out[key] = Value(value, value * float(np.exp(-half)), value * float(np.exp(half)), unit)
        else:
            out[key] = Value(value, value - half, value + half, unit)
    return out


def _stepped(effect: Effect, own: Floats, j: int, step: float) -> tuple[float, ...]:
    move = np.zeros(own.size)
    move[j] = step
    return moved([effect], own, move)[0].theta


def _covariance(problem: Problem, fitted: Fitted, sigma: float) -> Floats:
    """Of all internal parameters, then all amplitudes of the additive columns."""
    data = problem.data
    nuisance = len(data.names) + problem.base.width
    base, extra = fitted.design[:, :nuisance], fitted.design[:, nuisance:]
    _, jac = problem.jacobian(fitted, problem.output_of(fitted))
    x = problem.counted(np.concatenate([jac, extra], axis=1))
    b = problem.counted(base)
    gram = b.T @ b
    scale = np.sqrt(np.maximum(np.diag(gram), 1e-30))
    normed = gram / np.outer(scale, scale) + np.diag(problem.penalty(nuisance))
    x = x - b @ (np.linalg.solve(normed, (b.T @ x) / scale[:, None]) / scale[:, None])
    residual = problem.counted(data.y - fitted.prediction)
    unit = np.sqrt(np.maximum(np.sum(x**2, axis=0), 1e-30))
    x = x / unit
    a = x.T @ x + 1e-10 * np.eye(x.shape[1])
    inverse = np.linalg.pinv(a, hermitian=True, rcond=1e-12)
    white = inverse * sigma**2
    block = data.block[data.rows]
    ids = np.unique(block)
    moves = []
    for k in ids:
        here = block == k
        xb = x[here]
        moves.append(np.linalg.pinv(a - xb.T @ xb, hermitian=True, rcond=1e-8) @ (
            xb.T @ residual[here]
        ))  # fmt: skip
    m = np.array(moves)
    jack = (ids.size - 1) / ids.size * (m.T @ m)
    wide = np.maximum(np.sqrt(np.diag(jack) / np.maximum(np.diag(white), 1e-300)), 1.0)
    cov = white * np.outer(wide, wide)
    return cov / np.outer(unit, unit)
