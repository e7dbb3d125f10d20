"""Choose which model is written: the one that best predicts what it was not fitted to.

A shape is known where the recordings went. Beyond, such as on the first sweep from rest that no
recording shows, powers of its operators may diverge. There the base is pulled towards the model in
use by unrecorded rows with a weight of one millionth, which leaves the fit of the recorded rows
unchanged. If that is not enough, their weight is increased.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import chain

import numpy as np

from dehyst.models.cascade.simulate import simulate
from dehyst.models.diagnosis.augment import (
    REACH_S,
    is_within_reach,
    measure_difference_elsewhere,
    slow_sweeps,
)
from dehyst.models.diagnosis.base import ModelPrior, compact_base, rich_base
from dehyst.models.diagnosis.data.drive_path import is_one_period
from dehyst.models.diagnosis.effects import Effect
from dehyst.models.diagnosis.findings.weigh import Conclusion
from dehyst.models.diagnosis.fit import Problem
from dehyst.models.diagnosis.held_out import (
    HeldOutErrors,
    Refitted,
    WritableFit,
    make_held_out_groups,
)
from dehyst.models.diagnosis.joint_fit import JointFit
from dehyst.models.diagnosis.tuning import TUNING
from dehyst.models.errors import BadModel
from dehyst.models.model import Model
from dehyst.models.signals.joined import Bools, Data
from dehyst.models.signals.pasts import FRESH

MOST_ELSEWHERE = 2.0
"""Largest uncertainty on another drive at which a misfit counts as explained [noise rms], estimated
by leaving out parts of the recordings. The drive of this comparison is more demanding than most:
turns of any size at any place; models that predict to within half the noise rms reach 1.6."""


@dataclass(frozen=True)
class WrittenModel:
    """The model that is written; contains, contains_shape: keys of the effects in it, and whether
    the base's shape is.

    held: errors on rows that it was not fitted to; held_in_use: errors of the model in use on the
    same rows, as it is, also where it was identified from them; gained: whether it differs from the
    model in use; alone: mean square on each of two recordings when fitted to the other, where an
    effect began before them; else None. elsewhere: standard error [rms] on slow loops of any size
    and place, other than those recorded.
    """

    model: Model
    held: HeldOutErrors
    held_in_use: HeldOutErrors
    contains: tuple[str, ...] = ()
    contains_shape: bool = False
    gained: bool = False
    alone: float | None = None
    elsewhere: float = 0.0

    def explains(self, noise: float, removed: float) -> bool:
        """Return whether it leaves no more than half of the noise's power in addition to the noise
        [rms], and no more than half of what the model in use leaves, or next to nothing. Blocks of
        one recording show another drive less well than other recordings do: of these no more than a
        quarter may be left, and half must be explained. A line whose phase another recording does
        not share is left too. removed: mean square of what the readings were judged without.

        Of 213 simulated stages with up to the noise's power left, eight had more than 1.5 times the
        noise left on another drive; of 164 within these limits, one, with 1.51."""
        left = self.held.mean_square + removed - noise**2
        before = self.held_in_use.mean_square + removed - noise**2
        several = len(self.held.of_each) > 1
        nothing = TUNING.quarter * noise**2 if several else 0.0
        is_most = left <= max(TUNING.half * before, nothing)
        most = TUNING.half if several else TUNING.quarter
        is_small = self.gained and is_most and left <= most * noise**2
        is_known = self.holds_elsewhere(noise) and self.holds_in_each_alone(noise)
        return is_small and is_known

    def holds_elsewhere(self, noise: float) -> bool:
        """Return whether the recordings determine the model for another drive too. noise: rms."""
        return self.elsewhere <= MOST_ELSEWHERE * noise

    def holds_in_each_alone(self, noise: float) -> bool:
        """Return whether the same holds for each of two recordings when fitted to the other. Half
        of the rows were fitted, so twice as much may be left."""
        return self.alone is None or self.alone <= (1.0 + 2.0 * TUNING.half) * noise**2


def choose_written_model(
    data: Data, bare: Problem, weighed: Conclusion, sigma: float
) -> WrittenModel:
    """Return the plainest model that predicts what it was not fitted to as well as the best does,
    with no recording worse than with the model in use, and without a shape whose error on other
    loops may be 1.5 times what the model in use leaves; the model in use where none predicts better
    or all would diverge. data: all samples."""
    problem, final = weighed.problem, weighed.final
    written = [e for e in final.effects if is_determined(e, problem.data)]
    if problem.data.between is not None:  # a model assumes straight lines between samples
        problem = replace(problem, data=replace(problem.data, between=None))
    if problem is not weighed.problem or len(written) < len(final.effects):
        final = problem.refit(written)
    bare = replace(bare, data=replace(bare.data, between=None, stepped=problem.data.stepped))
    held_out = make_held_out_groups(problem, bare.data.u, effects=final.effects)
    in_use_model = bare.diagnosed.model
    in_use = held_out.held_out_errors(lambda here: in_use_model)
    unchanged = WrittenModel(in_use_model, in_use, in_use)
    noise = (TUNING.trace * sigma) ** 2
    bounded = is_within_reach(in_use_model, data)  # else it is not required of others
    if not final.effects and not problem.base.width:
        return unchanged

    def better(choice: WritableFit, best: WrittenModel) -> WrittenModel | None:
        try:
            held = held_out.held_out_errors(choice.write_without)
            model = choice.write()
            if bounded and not is_within_reach(model, data):
                return None
        except BadModel:  # a parameter value that the model format does not allow
            return None
        if held.mean_square > best.held.mean_square - noise:
            return None
        if choice.shape and len(data.names) == 1:
            known = bare.diagnosed.dynamic or in_use_model
            elsewhere = measure_difference_elsewhere(model, known, data)
            if elsewhere**2 > TUNING.near**2 * in_use.mean_square:
                return None  # it differs where this waveform has not been
        if held.worsens(in_use, TUNING.strong * sigma):
            return None
        return WrittenModel(model, held, in_use, choice.contains, choice.shape, gained=True)

    def choose(with_shape: bool) -> tuple[WrittenModel, WritableFit | None]:
        best, chosen = unchanged, None
        for choice in _choices(problem, bare, final, with_shape):
            if found := better(choice, best):
                best, chosen = found, choice
        while chosen is not None and chosen.problem is not bare:
            for fewer in [chosen.without(effect) for effect in chosen.fit.effects]:
                if found := better(fewer, best):
                    best, chosen = found, fewer
                    break
            else:
                break
        if chosen is None:
            return best, None
        elsewhere = _jackknife_elsewhere(chosen, held_out.groups, best.model)
        return replace(best, elsewhere=elsewhere), chosen

    best, chosen = choose(with_shape=True)
    misfit = in_use.mean_square - sigma**2
    if best.contains_shape and best.elsewhere**2 > TUNING.near**2 * misfit:
        # the recordings fix this shape less well than the model in use is known to predict
        best, chosen = choose(with_shape=False)
    # what began before a recording differs in each, which blocks of time left out do not show
    if chosen is not None and len(data.names) == 2 and any(e.candidate.past for e in final.effects):
        each = make_held_out_groups(problem, bare.data.u, True, final.effects)
        try:
            best = replace(best, alone=each.held_out_errors(chosen.write_without).mean_square)
        except BadModel:  # a parameter value that the model format does not allow
            best = replace(best, alone=np.inf)
    return best


def is_determined(effect: Effect, data: Data) -> bool:
    """Return whether the recordings fix the effect for another drive. A drive of one period shows a
    mode at its harmonics only, and there a hum that keeps time with the drive looks the same."""
    rings = effect.candidate.free_oscillation(effect.theta) is not None
    return not (rings and is_one_period(data))


def _jackknife_elsewhere(chosen: WritableFit, groups: Sequence[Bools], model: Model) -> float:
    """Return the standard error [rms] of a model on slow loops that were not recorded, by the
    jackknife: from the models that are fitted without each of the groups (N,)."""
    data, n = chosen.problem.data, len(groups)
    if n < 2:
        return 0.0  # nothing was left out
    try:
        without = [chosen.write_without(here) for here in groups]
    except BadModel:  # a parameter value that the model format does not allow
        return np.inf
    moved = [measure_difference_elsewhere(one, model, data) for one in without]
    error = float(np.sqrt((n - 1) / n * np.sum(np.square(moved))))
    return error if np.isfinite(error) else np.inf


def _choices(
    problem: Problem, bare: Problem, final: JointFit, with_shape: bool
) -> Iterator[WritableFit]:
    """Yield the models that may be written, the plainest first: the effects around the model in
    use, the same without each of them, the effects around a hysteresis that was refitted with them,
    and last, if it may be written, with the shape of the base, first with a stiffer prior of the
    base, then with a heavier pull towards the model in use."""
    effects = final.effects
    subsets = [effects, *([e for e in effects if e is not one] for one in effects)]
    for some in subsets[: 1 if len(effects) < 2 else None]:
        yield WritableFit(bare, bare.refit(some) if some else bare.solve([]), False)
    if not problem.base.width or problem.is_single_loop:
        return  # one loop does not show another's shape, whichever of its rows are left out
    if problem.has_few_distinct_places and not any(e.candidate.driven for e in effects):
        return  # nor do a few places of a path that is repeated
    if _is_fitted_pointwise(problem):  # a base of few columns interpolates between them
        problem = replace(problem, base=compact_base(problem.data))
        final = problem.refit(effects)
    output = problem.output_of(final)
    if effects and not problem.diagnosed.given:
        yield Refitted(problem, final, False)
    if not with_shape:
        return
    if is_one_period(problem.data):
        return  # nor do loops of several sizes show those around other places
    lightly = add_model_prior(problem, TUNING.leanings[0])
    stiffly = (replace(lightly, stiffness=stiffness) for stiffness in TUNING.stiffnesses)
    heavily = (add_model_prior(problem, weight) for weight in TUNING.leanings[1:])
    for held_to in chain(stiffly, heavily):
        yield WritableFit(held_to, held_to.solve(effects, output), True)


def add_model_prior(problem: Problem, weight: float) -> Problem:
    """Return the problem with added rows of a slow drive from rest over the whole range, on which
    the base is pulled towards the model in use. weight: total weight of these rows, relative to the
    recorded ones."""
    data, base = problem.data, problem.base
    u = slow_sweeps(data)
    starts = np.zeros(u.size, dtype=np.int64)
    starts[0] = FRESH
    columns = base.columns(u, starts)
    target = np.zeros(u.size)
    if not problem.diagnosed.carries:
        target = simulate(replace(problem.diagnosed.model, blocks=()), REACH_S, u)
    size = np.sqrt(weight * int(data.rows.sum()) / u.size)
    columns, target = columns - columns.mean(axis=0), target - target.mean()
    return replace(problem, model_prior=ModelPrior(size * columns, size * target))


def _is_fitted_pointwise(problem: Problem) -> bool:
    """Return whether the base has fitted individual places of the path, and nothing between
    them."""
    return problem.has_few_distinct_places and problem.base.width == rich_base(problem.data).width
