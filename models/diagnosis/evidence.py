"""Evidence for an effect: how well it predicts held-out samples, and whether it is the same
everywhere.

Groups of short time blocks are held out in turn, each predicted by weights that were fitted without
it. The nonlinear parameters are kept: they are a handful against thousands of samples.

With x the effect's contribution and r the residual without it, both projected off everything else
that is fitted, the amplitude over a group of samples is <x, r> / <x, x>; the fit makes it 1 over
all of them. A real effect has amplitude 1 in every group; an effect that imitates an error of the
base has amplitudes that scatter, and often the wrong sign in some recordings.
"""

from dataclasses import dataclass

import numpy as np

from dehyst.models.diagnosis.effects import Effect
from dehyst.models.diagnosis.fit import Problem
from dehyst.models.diagnosis.joint_fit import JointFit
from dehyst.models.signals.joined import Floats, Ints


@dataclass(frozen=True)
class Constancy:
    """Amplitudes by time block and by recording; 1 over all.

    spread: rms deviation from 1 over the blocks, weighted by each block's share of the
    contribution's power, beyond what noise causes; by_recording: (recordings,) amplitude; wrong:
    share of the fitted contribution's power in recordings that contradict it.
    """

    spread: float
    by_recording: Floats
    wrong: float


def contribution(problem: Problem, fitted: JointFit, effect: Effect) -> tuple[Floats, Floats]:
    """Return x (N,), r (N,): contribution of an effect and residual without it, both projected.

    The other effects keep their nonlinear parameters; all linear weights are refitted.
    """
    without = problem.without(fitted, effect)
    # gain of the joint fit at each sample
    x = fitted.prediction - without.prediction
    r = problem.data.y - without.prediction
    return x, r


def constancy(problem: Problem, sigma: float, x: Floats, r: Floats) -> Constancy:
    """Compute the amplitudes of a contribution over blocks and recordings."""
    data = problem.data
    used = data.rows

    def sums(groups: Ints) -> tuple[Floats, Floats]:
        g = groups[used]
        size = int(groups.max()) + 1
        xr = np.bincount(g, x[used] * r[used], size)
        xx = np.bincount(g, x[used] ** 2, size)
        return xr.astype(np.float64), xx.astype(np.float64)

    xr, xx = sums(data.block)
    total = max(float(xx.sum()), 1e-30)
    a = xr / np.maximum(xx, 1e-30)
    heavy = xx > 0.01 * total  # of the power: the amplitude of a lighter block is noise
    deviation = float(np.sum(xx[heavy] * (a[heavy] - 1) ** 2)) / total
    chance = sigma**2 * int(heavy.sum()) / total
    spread = float(np.sqrt(max(deviation - chance, 0.0)))
    rr, rx = sums(data.rec)
    by = rr / np.maximum(rx, 1e-30)
    weight = rx / total
    return Constancy(spread, by, float(weight[by < 0.3].sum()))  # of the fit's: contradicted


def blockwise_held_out_error(problem: Problem, fitted: JointFit) -> float:
    """Return the mean square error over all groups of short time blocks, each predicted by a fit
    without it. Samples in no group (below 0) are always fitted and never predicted."""
    data, x = problem.data, fitted.design
    groups, left = problem.counted(data.fold), problem.counted(data.y - fitted.fixed)
    ids = np.unique(groups[groups >= 0])
    slices = [np.flatnonzero(groups == g) for g in ids]
    pieces = [x[here] for here in slices]
    grams = [piece.T @ piece for piece in pieces]
    moments = [piece.T @ left[here] for piece, here in zip(pieces, slices, strict=True)]
    always = x[groups < 0]
    total = np.sum(grams, axis=0) + always.T @ always
    moment = np.sum(moments, axis=0) + always.T @ left[groups < 0]
    problem.model_prior.add_to(total, moment, len(data.names))
    scale = np.sqrt(np.maximum(np.diag(total), 1e-30))
    penalty = problem.penalty(scale.size)
    sse, count = np.zeros(ids.size), np.zeros(ids.size)
    for k, (piece, here) in enumerate(zip(pieces, slices, strict=True)):
        gram = (total - grams[k]) / np.outer(scale, scale) + np.diag(penalty)
        w = np.linalg.solve(gram, (moment - moments[k]) / scale) / scale
        sse[k] = float(np.sum((left[here] - piece @ w) ** 2))
        count[k] = here.size
    return float(sse.sum() / max(count.sum(), 1.0))
