"""Determine how much of a recording a single change to the model in use explains.

A stage that matched its model a minute ago has usually changed in one respect only. A diagnosis
refits the loop's shape together with each cause, and a shape can absorb much of a cause. Here only
the cause's parameters are fitted: each candidate of the library alone, around the model in use.
"""

from collections.abc import Sequence
from dataclasses import dataclass

from dehyst.models.diagnosis.base import no_base
from dehyst.models.diagnosis.data.excerpt import excerpt
from dehyst.models.diagnosis.data.noise import noise_rms
from dehyst.models.diagnosis.data.prepare import prepare, were_de_energised
from dehyst.models.diagnosis.diagnosed_model import take_given_model
from dehyst.models.diagnosis.fit import Problem
from dehyst.models.diagnosis.judge import CandidateTrial, SearchState, effect_of
from dehyst.models.diagnosis.pasts import choose_pasts
from dehyst.models.diagnosis.search import search_one_more
from dehyst.models.errors import BadInput
from dehyst.models.identify.validation import validate
from dehyst.models.model import Model
from dehyst.models.physics import changes_alone, list_candidates, with_blocks
from dehyst.models.physics.candidate import Candidate, may_be_confused
from dehyst.models.recording import Recording

SHORTLIST = 6
"""Number of candidates that are fully refitted."""


@dataclass(frozen=True)
class Cause:
    """name: word of the diagnosis' vocabulary; place: drive, stage or sensor; says: a sentence;
    model: the model in use with this change; confused_with: names of effects that look like it."""

    name: str
    place: str
    says: str
    model: Model
    confused_with: tuple[str, ...] = ()


@dataclass(frozen=True)
class WeighedCause:
    """left: rms residual of the cause's model on later telemetry; new: mean square that the model
    removes there, minus that which it removes from the good recording."""

    cause: Cause
    left: float
    new: float


def find_causes(model: Model, recording: Recording) -> list[Cause]:
    """Return the single causes, the one that removes most first. Rows without a reading only drive
    the stage's memory and are not fitted. Raises BadInput, BadRecording like a diagnosis."""
    data = choose_pasts(excerpt(prepare([recording], were_de_energised([recording]))))
    problem = Problem(data, no_base(data), take_given_model(model, data))
    null = problem.solve([])
    sigma = noise_rms(data, null.residual(data))
    state = SearchState(problem, sigma, null, null, counted=int(data.rows.sum()))
    state = search_one_more(state, SHORTLIST, changes_alone(data))
    known = list_candidates(data)
    return [_as_cause(model, problem, t, known) for t in state.rounds[0] if not t.refused]


def _as_cause(
    model: Model, problem: Problem, trial: CandidateTrial, known: Sequence[Candidate]
) -> Cause:
    one, fit = trial.candidate, trial.fit
    effect = effect_of(fit, one.key)
    amplitudes = fit.amplitudes_of(effect)
    blocks = one.blocks(effect.theta, amplitudes, problem.data)
    says = one.describe(one.values(effect.theta, amplitudes))
    alike = _names_confused_with(one, known)
    return Cause(one.name, one.place, says, with_blocks(model, blocks), alike)


def _names_confused_with(one: Candidate, others: Sequence[Candidate]) -> tuple[str, ...]:
    """Return the names that may be confused with an effect's name, in any of its forms, whichever
    of the two declares it."""
    forms = [one, *(c for c in others if c.name == one.name)]
    names = [name for form in forms for name in form.confused_with]
    names += [c.name for c in others for form in forms if may_be_confused(c, form)]
    return tuple(dict.fromkeys(name for name in names if name != one.name))


def weigh_causes(
    in_use: Model, causes: Sequence[Cause], later: Recording, good: Recording | None
) -> list[WeighedCause]:
    """Return the causes in descending order of `new`, without those whose model cannot be run on
    the recordings. good: a recording from when the model was right, or None."""
    before = validate(in_use, later).rms ** 2
    when_good = validate(in_use, good).rms ** 2 if good is not None else 0.0
    found = []
    for cause in causes:
        try:
            left = validate(cause.model, later).rms
            new = before - left**2
            if good is not None:
                new -= max(0.0, when_good - validate(cause.model, good).rms ** 2)
        except BadInput:
            continue
        found.append(WeighedCause(cause, left, new))
    return sorted(found, key=lambda one: -one.new)
