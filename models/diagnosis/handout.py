"""The augmented model that is handed out: with all that was found, and nowhere astray.

A shape is known where the recordings went. Beyond, on the way up from rest that no recording shows,
powers of its operators may go anywhere. There the base is held to the model in use, by rows that
were not recorded and weigh a millionth: what the recordings tell stays as it is. Where that does
not hold it, they weigh more.
"""

from dataclasses import dataclass, replace

import numpy as np

from dehyst.models.cascade.simulate import simulate
from dehyst.models.diagnosis.augment import REACH_S, augmented, slow_ways, stays_in_reach
from dehyst.models.diagnosis.base import Leaning, rich_base
from dehyst.models.diagnosis.data.survey import left_of
from dehyst.models.diagnosis.evidence import by_blocks
from dehyst.models.diagnosis.findings.weigh import Weighed
from dehyst.models.diagnosis.fit import Problem
from dehyst.models.diagnosis.joint_fit import JointFit, solve_ridged
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
    model in use; the first that is nowhere worse than that one by more than the noise, does not
    go astray where nothing was recorded, and predicts most recordings from the others no worse
    than that one leaves them. bare_left: (N,) what the model in use leaves."""
    problem, final, first = weighed.problem, weighed.final, weighed.held
    if problem.data.between is not None:  # a model runs along straight lines
        problem = replace(problem, data=replace(problem.data, between=None))
        final = problem.refit(final.effects)
        first = by_blocks(problem, final).mean_square
    if problem.data.stepped:
        problem, final = as_blocks(problem, final)
        bare = bare.with_steps(False, led=problem.data.led)
        first = by_blocks(problem, final).mean_square

    def tried(problem: Problem, fit: JointFit, held: float, whole: bool) -> Handed:
        model = augmented(problem, fit)
        left = left_of(data, replace(bare.subject, model=model).whole(data))
        return Handed(model, left, held, whole)

    def is_good(problem: Problem, fit: JointFit, out: Handed) -> bool:
        return (
            not _knows_each_alone(problem)
            and stays_in_reach(out.model, data)
            and not _is_worse(data, out.left, bare_left, sigma)
            and not foretells_worse(problem, fit, bare)
        )

    def effects_alone(most: float) -> Handed | None:
        fit = bare.refit(final.effects)
        out = tried(bare, fit, by_blocks(bare, fit).mean_square, False)
        return None if out.held > most or _is_worse(data, out.left, bare_left, sigma) else out

    if final.effects and not any(f.name == "shape" for f in weighed.findings):
        # no shape is told, and none is handed out that other drives would meet
        plainer = effects_alone(min(weighed.bare, first + (TUNING.shape_size * sigma) ** 2))
        if plainer is not None:
            return plainer
    best: Handed | None = None
    for weight in TUNING.leanings if problem.base.width else (0.0,):
        held_to, fit, held = problem, final, first
        if weight:
            held_to = lean_on_the_model(problem, weight)
            fit = held_to.solve(final.effects, problem.output_of(final))
            held = by_blocks(held_to, fit).mean_square
        out = tried(held_to, fit, held, True)
        if not is_good(held_to, fit, out):
            continue
        if best is None or np.std(out.left[data.rows]) < np.std(best.left[data.rows]):
            best = out
        if _does_as_fitted(out.left[data.rows], fit.residual(held_to.data)[held_to.data.rows]):
            break  # else a past that the model cannot begin with stands in its way
    plainer = effects_alone(weighed.bare) if final.effects and best is None else None
    return best or plainer or Handed(bare.subject.model, bare_left, weighed.bare, False)


def _does_as_fitted(left: Floats, fitted: Floats) -> bool:
    """Whether a written model leaves no more than the fit that it was made of."""
    return bool(np.std(left) < TUNING.as_fitted * np.std(fitted))


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


def foretells_worse(problem: Problem, fit: JointFit, bare: Problem) -> bool:
    """Whether most recordings are left with more by weights that the others gave than by the model
    in use: what the base has learned then is not the stage's. Levels aside, and what is a
    recording's own, as what its past has left; not for one alone."""
    data, x = problem.data, fit.design
    count = len(data.names)
    if count < 2 or not problem.base.width:
        return False
    target, rec = problem.counted(data.y - fit.fixed), problem.counted(data.rec)
    before = replace(bare, data=replace(bare.data, y=data.y)).solve([]).residual(data)
    penalty = problem.penalty(x.shape[1])
    worse = 0
    for i in range(count):
        here = rec == i
        gram, moment = x[~here].T @ x[~here], x[~here].T @ target[~here]
        problem.leaning.add_to(gram, moment, count)
        w, _ = solve_ridged(gram, moment, penalty)
        if not here.any():
            continue
        left, own = target[here] - x[here] @ w, x[here][:, ~x[~here].any(axis=0)]
        left -= own @ np.linalg.lstsq(own, left)[0]
        worse += bool(np.std(left) > TUNING.foretold * np.std(problem.counted(before)[here]))
    return bool(2 * worse > count)


def _knows_each_alone(problem: Problem) -> bool:
    """Whether the base has learned places one by one, and nothing of what lies between them."""
    return problem.few_places and problem.base.width == rich_base(problem.data).width


def _is_worse(data: Data, left: Floats, before: Floats, sigma: float) -> bool:
    """Whether a model leaves more than the one before, by more than half the noise: of any
    recording, in its rows that count or in all."""
    for i in range(len(data.names)):
        here = (data.rec == i) & (data.raw_index >= 0)
        for k in (here, here & data.rows):
            if np.std(left[k]) > np.std(before[k]) + TUNING.no_worse * sigma:
                return True
    return False
