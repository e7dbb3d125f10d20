"""Which model is written: the one that predicts what it was not fitted to.

A shape is known where the recordings went. Beyond, on the way up from rest that no recording shows,
powers of its operators may go anywhere. There the base is held to the model in use, by rows that
were not recorded and weigh a millionth: what the recordings tell stays as it is. Where that does
not hold it, they weigh more.
"""

from collections.abc import Iterator
from dataclasses import dataclass, replace
from itertools import chain

import numpy as np

from dehyst.models.cascade.simulate import simulate
from dehyst.models.diagnosis.augment import REACH_S, slow_ways, stays_in_reach
from dehyst.models.diagnosis.base import Leaning, rich_base
from dehyst.models.diagnosis.findings.weigh import Conclusion
from dehyst.models.diagnosis.fit import Problem
from dehyst.models.diagnosis.joint_fit import JointFit
from dehyst.models.diagnosis.left_out import HeldOutErrors, Refitted, WritableFit, leave_out
from dehyst.models.diagnosis.tuning import TUNING
from dehyst.models.errors import BadModel
from dehyst.models.model import Model
from dehyst.models.signals.joined import Data
from dehyst.models.signals.pasts import FRESH


@dataclass(frozen=True)
class Handed:
    """The model that is written; contains: keys of the effects in it, and whether the shape is.

    held: what it leaves of rows that it was not fitted to; held_in_use: what the model in use
    leaves of the same rows, as it is, also where it was identified from them; gained: whether it is
    another than the model in use.
    """

    model: Model
    held: HeldOutErrors
    held_in_use: HeldOutErrors
    contains: tuple[str, ...] = ()
    contains_shape: bool = False
    gained: bool = False

    def explains(self, noise: float) -> bool:
        """Whether something was gained, and what is left is near the noise [rms]."""
        return self.gained and self.held.known <= (TUNING.near * noise) ** 2


def hand_out(data: Data, bare: Problem, weighed: Conclusion, sigma: float) -> Handed:
    """Of the models with what was found, the plainest that predicts what it was not fitted to as
    well as the best does, and its worst recording no worse than the model in use its own; the model
    in use, where none predicts better than it or all would go astray. data: all samples."""
    problem, final = weighed.problem, weighed.final
    if problem.data.between is not None:  # a model runs along straight lines
        problem = replace(problem, data=replace(problem.data, between=None))
        final = problem.refit(final.effects)
    if problem.data.stepped:
        problem, final = as_blocks(problem, final)
        bare = bare.with_steps(False, led=problem.data.led)
    bare = replace(bare, data=replace(bare.data, between=None))
    left_out = leave_out(problem, final, bare.data.u)
    in_use = left_out.left_by(lambda here: bare.subject.model)
    best, chosen = Handed(bare.subject.model, in_use, in_use), None
    noise = (TUNING.trace * sigma) ** 2
    if not final.effects and not problem.base.width:
        return best

    def better(choice: WritableFit) -> Handed | None:
        try:
            held = left_out.left_by(choice.write_without)
            model = choice.write()
            if not stays_in_reach(model, data):
                return None
        except BadModel:  # a value that no model may have
            return None
        if held.mean_square > best.held.mean_square - noise:
            return None
        if held.worst > in_use.worst + TUNING.strong * sigma:
            return None
        return Handed(model, held, in_use, choice.contains, choice.shape, gained=True)

    for choice in _choices(problem, bare, final):
        if handed := better(choice):
            best, chosen = handed, choice
    while chosen is not None and chosen.problem is not bare:
        for fewer in [chosen.without(effect) for effect in chosen.fit.effects]:
            if handed := better(fewer):
                best, chosen = handed, fewer
                break
        else:
            break
    return best


def _choices(problem: Problem, bare: Problem, final: JointFit) -> Iterator[WritableFit]:
    """What may be written, the plainest first: the effects around the model in use, without each
    of them, around a hysteresis that was fitted again beside them, and with the shape of the base,
    the stiffer held the earlier."""
    effects = final.effects
    subsets = [effects, *([e for e in effects if e is not one] for one in effects)]
    for some in subsets[: 1 if len(effects) < 2 else None]:
        yield WritableFit(bare, bare.refit(some) if some else bare.solve([]), False)
    if not problem.base.width or _knows_each_alone(problem) or problem.one_loop_alone:
        return  # one loop says nothing of another's shape, whichever of its rows are left out
    output = problem.output_of(final)
    if effects and not problem.subject.given:
        yield Refitted(problem, final, False)
    lightly = lean_on_the_model(problem, TUNING.leanings[0])
    stiffly = (replace(lightly, stiffness=stiffness) for stiffness in TUNING.stiffnesses)
    heavily = (lean_on_the_model(problem, weight) for weight in TUNING.leanings[1:])
    for held_to in chain(stiffly, heavily):
        yield WritableFit(held_to, held_to.solve(effects, output), True)


def as_blocks(problem: Problem, fit: JointFit) -> tuple[Problem, JointFit]:
    """A fit by steps as blocks can hold it, which are fed by straight lines: behind a lead of half
    a sample where that leaves less. It leads all that passes the mode, also what the mode does not
    carry, and does not where that is most."""
    fed = [problem.with_steps(False, led) for led in (False, True)]
    both = [(one, one.refit(fit.effects)) for one in fed]
    return min(both, key=lambda pair: pair[1].sse)


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


def _knows_each_alone(problem: Problem) -> bool:
    """Whether the base has learned places one by one, and nothing of what lies between them."""
    return problem.few_places and problem.base.width == rich_base(problem.data).width
