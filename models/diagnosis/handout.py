"""The augmented model that is handed out: with all that was found, and nowhere astray.

A shape is known where the recordings went. Beyond, on the way up from rest that no recording shows,
powers of its operators may go anywhere. There the base is held to the model in use, by rows that
were not recorded and weigh little: what the recordings tell stays as it is.
"""

from dataclasses import dataclass, replace

import numpy as np

from dehyst.models.cascade.simulate import simulate
from dehyst.models.diagnosis.augment import REACH_S, augmented, slow_ways, stays_in_reach
from dehyst.models.diagnosis.base import Leaning
from dehyst.models.diagnosis.data.survey import left_of
from dehyst.models.diagnosis.evidence import by_blocks
from dehyst.models.diagnosis.findings.weigh import Weighed
from dehyst.models.diagnosis.fit import Problem
from dehyst.models.diagnosis.joint_fit import JointFit
from dehyst.models.diagnosis.tuning import TUNING
from dehyst.models.model import Model
from dehyst.models.signals.joined import Data, Floats
from dehyst.models.signals.pasts import FRESH


@dataclass(frozen=True)
class Handed:
    """The augmented model; left: (N,) what it leaves of all samples; held: mean square that it
    leaves of held-out ones."""

    model: Model
    left: Floats
    held: float
    contains_shape: bool = True


def hand_out(
    data: Data, bare: Problem, weighed: Weighed, bare_left: Floats, sigma: float
) -> Handed:
    """The model that is handed out: with all that was found, else with the effects alone, else the
    model in use; the first that is nowhere worse than that one by more than the noise, and does not
    go astray where nothing was recorded. bare_left: (N,) what the model in use leaves."""
    problem, final, first = weighed.problem, weighed.final, weighed.held
    if problem.data.stepped:  # a block is fed by straight lines
        problem = problem.with_steps(False)
        final = problem.refit(final.effects)
        first = by_blocks(problem, final).mean_square

    def tried(problem: Problem, fit: JointFit, held: float, whole: bool) -> Handed:
        model = augmented(problem, fit)
        left = left_of(data, replace(bare.subject, model=model).whole(data))
        return Handed(model, left, held, whole)

    out = tried(problem, final, first, True)
    for weight in TUNING.leanings if problem.base.width else ():
        if stays_in_reach(out.model, data) and not _is_worse(data, out.left, bare_left, sigma):
            return out
        held_to = lean_on_the_model(problem, weight)
        fit = held_to.solve(final.effects, problem.output_of(final))
        out = tried(held_to, fit, by_blocks(held_to, fit).mean_square, True)
    if stays_in_reach(out.model, data) and not _is_worse(data, out.left, bare_left, sigma):
        return out
    if final.effects:
        fit = bare.refit(final.effects)
        out = tried(bare, fit, by_blocks(bare, fit).mean_square, False)
        if out.held < weighed.bare and not _is_worse(data, out.left, bare_left, sigma):
            return out
    return Handed(bare.subject.model, bare_left, weighed.bare, False)


def lean_on_the_model(problem: Problem, weight: float) -> Problem:
    """The problem with rows of a slow way from rest over the whole range, on which the base is held
    to the model in use. weight: of all these rows, in that of the recorded ones."""
    data, base = problem.data, problem.base
    u = slow_ways(data)
    starts = np.zeros(u.size, dtype=np.int64)
    starts[0] = FRESH
    columns = base.columns(u, starts)
    target = np.zeros(u.size)
    if not problem.subject.carries:
        target = simulate(replace(problem.subject.model, blocks=()), REACH_S, u)
    size = np.sqrt(weight * int(data.rows.sum()) / u.size)
    columns, target = columns - columns.mean(axis=0), target - target.mean()
    return replace(problem, leaning=Leaning(size * columns, size * target))


def _is_worse(data: Data, left: Floats, before: Floats, sigma: float) -> bool:
    """Whether a model leaves more than the one before, by more than the noise: of any recording, in
    its rows that count or in all."""
    for i in range(len(data.names)):
        here = (data.rec == i) & (data.raw_index >= 0)
        for k in (here, here & data.rows):
            if np.std(left[k]) > np.std(before[k]) + sigma:
                return True
    return False
