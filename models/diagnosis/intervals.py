"""95 % intervals of the parameters of a joint fit.

White noise alone would give intervals far too narrow where the base has an error of its own, so the
spread between time blocks counts too: the sandwich of the blocks' scores, each corrected for the
leverage of the fit on its own residual, the base's part included (R. Bell, D. McCaffrey, Survey
Methodology 28, 2002, "bias reduced linearisation"), with Student's t for that number of blocks. The
wider of the two is used. The uncertainty that sampling causes (`Parameter.sure`, `within`) is added
as an independent error. As a prior, a nonlinear parameter lies within its bounds, so that a time
constant that the recordings do not determine does not make the size unknown as well.
"""

from collections.abc import Sequence

import numpy as np
from scipy.special import stdtrit

from dehyst.models.diagnosis.effects import Effect, internal_parameters, move_parameters
from dehyst.models.diagnosis.fit import Problem
from dehyst.models.diagnosis.joint_fit import JointFit
from dehyst.models.diagnosis.result import Value
from dehyst.models.diagnosis.tuning import TUNING
from dehyst.models.signals.joined import Floats


def intervals(problem: Problem, fitted: JointFit, sigma: float) -> list[dict[str, Value]]:
    """Return, for each effect of the fit in order, parameter key -> value with its interval."""
    if not fitted.effects:
        return []
    cov = _covariance(problem, fitted, sigma)
    p = internal_parameters(fitted.effects)
    out = []
    theta_at, amplitude_at = 0, p.size
    for i, effect in enumerate(fitted.effects):
        amplitudes = fitted.amplitudes[i]
        theta_to, amplitude_to = theta_at + len(effect.theta), amplitude_at + amplitudes.size
        at = np.r_[theta_at:theta_to, amplitude_at:amplitude_to]
        theta_at, amplitude_at = theta_to, amplitude_to
        least = 0.0 if is_time_known(problem, effect) else TUNING.half
        out.append(_values(fitted, i, p, cov[np.ix_(at, at)], least))
    return out


def is_time_known(problem: Problem, effect: Effect) -> bool:
    """Return whether the recordings determine an effect's time. A rich base imitates a lag or a
    delay where the drive is sampled at few moments of its period, also in rows left out."""
    return not (problem.has_few_distinct_moments and effect.candidate.late)


def are_times_known(problem: Problem, fitted: JointFit) -> bool:
    """Return whether the same holds for all effects of a fit."""
    return all(is_time_known(problem, effect) for effect in fitted.effects)


def _values(fitted: JointFit, index: int, p: Floats, cov: Floats, least: float) -> dict[str, Value]:
    """Return the reported values of one effect, with intervals by finite differences of the
    reported values. least: smallest relative half width of the nonlinear parameters."""
    effect, amplitudes = fitted.effects[index], fitted.amplitudes[index]
    best = effect.candidate.values(effect.theta, amplitudes)
    count = len(effect.theta)
    own = internal_parameters([effect])
    gradient: dict[str, list[float]] = {key: [] for key in best}
    sure = {
        p.key: max(p.sure + (p.within / abs(v) if p.within else 0.0), least)
        for p, v in zip(effect.parameters, effect.theta, strict=True)
    }
    most = {p.key: p.high for p in effect.parameters if p.whole}  # bounds that are limits
    log = {key: value > 0 for key, (value, _) in best.items()}
    for j in range(cov.shape[0]):
        size = max(float(np.sqrt(cov[j, j])), 1e-12)
        step = min(0.1 * size, 1e-2) if j < count else 0.1 * size  # of its error: nearly linear
        theta, amps = effect.theta, np.array(amplitudes)
        if j < count:
            theta = _stepped(effect, own, j, step)
            actual = internal_parameters([Effect(effect.candidate, theta)])[j] - own[j]
            if abs(actual) < 0.5 * step:  # a bound stopped it
                theta = _stepped(effect, own, j, -step)
                actual = internal_parameters([Effect(effect.candidate, theta)])[j] - own[j]
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
        half = TUNING.interval_width * float(np.sqrt(max(g @ cov @ g, 0.0)))
        half = float(np.hypot(half, sure.get(key, 0.0) * (1.0 if log[key] else abs(value))))
        if log[key]:
            half = min(half, 20.0)  # logarithm: a factor of 5e8 says as little as any larger one
            high = min(value * float(np.exp(half)), most.get(key, np.inf))
            out[key] = Value(value, value * float(np.exp(-half)), high, unit)
        else:
            out[key] = Value(value, value - half, value + half, unit)
    return out


def _stepped(effect: Effect, own: Floats, j: int, step: float) -> tuple[float, ...]:
    move = np.zeros(own.size)
    move[j] = step
    return move_parameters([effect], own, move)[0].theta


def _spread_before(effects: Sequence[Effect]) -> Floats:
    """Return the prior standard deviation of each internal parameter, uniform within its bounds."""
    width = [
        np.log(p.high / p.low) if p.log else 1.0 for effect in effects for p in effect.parameters
    ]
    return np.array(width) / np.sqrt(12.0)


def _covariance(problem: Problem, fitted: JointFit, sigma: float) -> Floats:
    """Return the covariance of all internal parameters, then of all amplitudes of the additive
    columns."""
    data = problem.data
    nuisance = len(data.names) + problem.base.width
    base, extra = fitted.design[:, :nuisance], fitted.design[:, nuisance:]
    _, jac = problem.jacobian(fitted, problem.output_of(fitted))
    x = np.concatenate([base, problem.counted(jac), extra], axis=1)
    residual = problem.counted(data.y - fitted.prediction)
    known = np.zeros(x.shape[1])  # prior: all that is known where the recordings say nothing
    known[nuisance : nuisance + jac.shape[1]] = (sigma / _spread_before(fitted.effects)) ** 2
    unit = np.sqrt(np.maximum(np.sum(x**2, axis=0) + known, 1e-30))
    x = x / unit
    ridge = np.full(x.shape[1], 1e-10)  # of the unit diagonal: against exact collinearity only
    ridge[:nuisance] = problem.penalty(nuisance)
    ridge += known / unit**2
    values, vectors = np.linalg.eigh(x.T @ x + np.diag(ridge))
    whitened = vectors / np.sqrt(np.maximum(values, 1e-14 * values[-1]))  # rounding
    own = whitened[nuisance:]
    white = sigma**2 * own @ own.T
    block = data.block[data.rows]
    moves = []
    for k in np.unique(block):
        here = block == k
        z = x[here] @ whitened
        leverage, along = np.linalg.eigh(z.T @ z)
        left = np.sqrt(1.0 - np.minimum(leverage, 1.0 - TUNING.crumb))
        moves.append(own @ (along @ ((along.T @ (z.T @ residual[here])) / left)))
    blocks = np.array(moves)
    between = blocks.T @ blocks
    student = float(stdtrit(max(len(moves) - 1, 1), 0.975)) / TUNING.interval_width
    wide = student * np.sqrt(np.diag(between) / np.maximum(np.diag(white), 1e-300))
    wide = np.maximum(wide, 1.0)
    cov = white * np.outer(wide, wide)
    return cov / np.outer(unit[nuisance:], unit[nuisance:])
