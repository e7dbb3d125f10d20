"""Choose the strength of the prior, and which of a few powers of z to keep, by log evidence.

Hold-out says little about effects where the recording has no data: one or two sines hardly
distinguish a saturation from a rate-dependence that acts on one side of the range. The evidence of
a linear model with Gaussian noise and prior (D. J. C. MacKay, Neural Computation 4, 1992), at the
bounded solution, weighs what a structure explains against how much else it could have explained.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np

from dehyst.models.identify.bounded import bounded_solve
from dehyst.models.identify.equations import Shape
from dehyst.models.identify.structure import Trial, TriedStructure, pays
from dehyst.models.identify.thresholds import Prior
from dehyst.models.identify.tuning import TUNING
from dehyst.models.recording import Floats


@dataclass(frozen=True)
class ProbableStructure:
    """A structure at the prior that maximises the evidence. evidence: its logarithm, up to a
    constant that structures of one kind share; noise: noise power with which it was computed."""

    candidate: TriedStructure
    prior: Prior
    evidence: float
    noise: float


Strengths = tuple[float, float]  # of the prior, and its rate_share


def maximise_evidence(trial: Trial, shape: Shape, noise: float | None = None) -> ProbableStructure:
    """Return a structure at the strengths of the prior that maximise the evidence, among those that
    can be inverted and that hold-out does not contradict.

    noise: noise power; None: the power of the structure's own residual.
    """
    known = trial.setup.strengths
    each = [trial.score(shape, (strength,)) for strength in known[::2]]
    best = min(each, key=lambda c: c.held_rms)
    # three steps between strengths, mostly factors of 3: finer than hold-out's factors of 30 and
    # more, which the evidence can afford, as a strength costs one solve instead of one per fold
    finer = sorted({float(s) for a, b in pairwise(known) for s in np.geomspace(a, b, 4)})
    plain = trial.prior
    share = plain.rate_share
    if noise is None:
        noise = _measure_noise(trial, shape, finer)
    tried: dict[Strengths, float] = {}
    for turn in range(3 if shape.rate else 1):  # along one of the two, then the other
        if turn:
            share = max(tried, key=lambda at: tried[at])[1]
        _weigh(trial, shape, [(s, share) for s in finer], noise, tried)
        if shape.rate and turn < 2:
            strength = max(tried, key=lambda at: tried[at])[0]
            _weigh(trial, shape, [(strength, s) for s in TUNING.rate_shares], noise, tried)
    for at in sorted(tried, key=lambda at: -tried[at]):
        trial.prior = replace(plain, rate_share=at[1])
        found = trial.score(shape, at[:1])
        if found.invertible and not pays(found, best, clear=0.0):
            return ProbableStructure(found, trial.prior, tried[at], noise)
    trial.prior = plain
    at = (best.strength, plain.rate_share)
    _weigh(trial, shape, [at], noise, tried)
    return ProbableStructure(best, plain, tried[at], noise)


def _measure_noise(trial: Trial, shape: Shape, strengths: Sequence[float]) -> float:
    """Return the power of the residual at the weakest prior: an upper limit of the noise power."""
    total = trial.total(shape)
    low, high = trial.bound(shape)
    p, _ = bounded_solve(total.gram, total.right, low, high)
    noise = total.noise_at(p)
    whole = trial.prior.add_to(total, shape.rate, strengths[0], noise, trial.loose)
    p, _ = bounded_solve(whole.gram, whole.right, low, high)
    return total.noise_at(p)


def _weigh(
    trial: Trial,
    shape: Shape,
    strengths: Sequence[Strengths],
    noise: float,
    tried: dict[Strengths, float],
) -> None:
    """Write the log evidence at each of these strengths into `tried`, up to a constant."""
    total = trial.total(shape)
    low, high = trial.bound(shape)
    size = trial.like.slopes.size
    level = np.full((size, size), 1.0 / (trial.setup.slope**2 * size))
    bends = _expect_bends(trial, shape, total.gram.shape[0])
    free = None
    for at in strengths:
        if at in tried:
            continue
        prior = replace(trial.prior, rate_share=at[1]).gram(shape.rate, at[0], trial.loose)
        gram = total.gram.copy()
        gram[:size, :size] += noise * prior
        p, free = bounded_solve(gram, total.right, low, high, free)
        slopes = p[:size]
        cost = total.misfit_at(p) / noise + float(slopes @ prior @ slopes) + float(bends @ p**2)
        whole = gram / noise + np.diag(bends)
        # leave out unknowns that no row determines: a recording without rows shows no shift
        shown = np.flatnonzero(np.diag(whole) > 0.0)
        spread = _log_det(whole[np.ix_(shown, shown)])
        known = _log_det(prior + level) + float(np.log(bends[bends > 0.0]).sum())
        tried[at] = 0.5 * (known - spread - cost)


def _expect_bends(trial: Trial, shape: Shape, size: int) -> Floats:
    """Return the inverse variances (p,) of the coefficients of the powers of z, 0 elsewhere: a
    saturation is expected to bend the curve by TUNING.small of the displacement over half the
    range."""
    out = np.zeros(size)
    half = 0.5 * trial.setup.slope * trial.setup.span
    begin = trial.like.slopes.size
    for at, power in enumerate(shape.powers):
        if power:
            out[begin + at] = (half ** (power - 1) / TUNING.small) ** 2
    return out


def _log_det(matrix: Floats) -> float:
    scale = np.sqrt(np.diag(matrix))
    unit = matrix / np.outer(scale, scale)
    return float(np.linalg.slogdet(unit)[1]) + 2.0 * float(np.log(scale).sum())
