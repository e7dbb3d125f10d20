"""Held-out misfit: each time block, or each recording, predicted by weights that never saw it.

The nonlinear parameters stay (a handful against thousands of samples); offsets of a block's
recording come from its other blocks, or from the held-out recording itself when a whole
recording is left out, as nuisances.
"""

from dataclasses import dataclass

import numpy as np

from dehyst.models.diagnosis.data import Floats, Ints
from dehyst.models.diagnosis.fit import Fitted, Problem


@dataclass(frozen=True)
class HeldOut:
    """prediction (N,): every sample by a fit without its group; sse: per group."""

    prediction: Floats
    groups: Ints
    sse: Floats
    count: Floats

    @property
    def mean_square(self) -> float:
        """Mean square error over all groups."""
        return float(self.sse.sum() / max(self.count.sum(), 1.0))


def by_blocks(problem: Problem, fitted: Fitted) -> HeldOut:
    """Leave out one group of short time blocks at a time."""
    return _leave_out(problem, fitted, problem.data.fold, nuisance=0)


def by_recordings(problem: Problem, fitted: Fitted) -> HeldOut:
    """Leave out one recording at a time; its offset is fitted on itself."""
    return _leave_out(problem, fitted, problem.data.rec, nuisance=len(problem.data.names))


def _leave_out(problem: Problem, fitted: Fitted, groups: Ints, nuisance: int) -> HeldOut:
    data, x = problem.data, fitted.design
    ids = np.unique(groups)
    grams, moments, slices = [], [], []
    for g in ids:
        here = np.flatnonzero((groups == g) & data.rows)
        slices.append(here)
        xg = x[here[0] : here[-1] + 1] if here.size == here[-1] - here[0] + 1 else x[here]
        grams.append(xg.T @ xg)
        moments.append(xg.T @ data.y[here])
    total, moment = np.sum(grams, axis=0), np.sum(moments, axis=0)
    scale = np.sqrt(np.maximum(np.diag(total), 1e-30))
    penalty = problem.penalty(scale.size)
    prediction = np.array(fitted.prediction)
    sse, count = np.zeros(ids.size), np.zeros(ids.size)
    for k, here in enumerate(slices):
        gram = (total - grams[k]) / np.outer(scale, scale) + np.diag(penalty)
        w = np.linalg.solve(gram, (moment - moments[k]) / scale) / scale
        guess = x[here] @ w
        if nuisance:
            guess = guess - np.mean(guess - data.y[here])
        prediction[here] = guess
        sse[k] = float(np.sum((data.y[here] - guess) ** 2))
        count[k] = here.size
    return HeldOut(prediction, ids.astype(np.int64), sse, count)
