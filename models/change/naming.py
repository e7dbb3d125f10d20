"""What is named: the diagnosis' findings in the order of what is new, or one change alone.

A diagnosis fits the loop's shape anew beside each cause. A shape can take what belongs to the
cause, and then no cause is seen behind it. Where one change alone, beside the model in use, leaves
no more of later telemetry than that model left when all was well, nothing else is needed.
"""

import math
from collections.abc import Sequence
from dataclasses import replace
from typing import NamedTuple

from dehyst.models.change.causes import Cause, WeighedCause
from dehyst.models.change.replay import with_blocks
from dehyst.models.diagnosis import Finding
from dehyst.models.model import Model
from dehyst.models.physics import KINDS

EXPLAINED = 0.15  # of the power that is new, that one change may leave
WEAK = 0.25  # of what the best cause alone removes: less is not the change
OWN = 0.5  # of the power that the model in use left when all was well: it favours either of two


class ChangeResiduals(NamedTuple):
    """rms that is left: by the model in use of later telemetry, and of the good recording (NaN:
    there is none); by all that the diagnosis found, of later telemetry; noise."""

    in_use: float
    when_good: float
    found: float
    noise: float


def rank_findings(
    findings: Sequence[Finding], causes: Sequence[WeighedCause], least: float, noise2: float
) -> list[Finding]:
    """What is new first: by the mean square that each finding's cause alone removes of later
    telemetry and not of the good recording, and where that is as good as the best but for the
    noise's (noise2), by the diagnosis' share; then the loop's shape, then what removes less than
    `least` or than a part of what any cause alone removes, then what nothing explains."""
    new: dict[str, float] = {}
    for one in causes:
        new[one.cause.name] = max(new.get(one.cause.name, 0.0), one.new)
    best = max((new.get(f.name, 0.0) for f in findings), default=0.0)
    least = max(least, WEAK * max(new.values(), default=0.0))

    def rank(finding: Finding) -> tuple[int, float, float]:
        of_it = new.get(finding.name, 0.0)
        last = {"shape": 1, "unknown": 3}.get(finding.name, 0 if of_it >= least else 2)
        return last, -best if of_it >= best - noise2 else -of_it, -finding.share

    return sorted(findings, key=rank)


def find_one_change(
    findings: Sequence[Finding], causes: Sequence[WeighedCause], left: ChangeResiduals
) -> WeighedCause | None:
    """The cause that alone explains all that is new, where the diagnosis does not name it and
    needs more than one name, or a shape; or that alone explains most of it, and more than the
    effect that the diagnosis names first and with which it may be confused. findings, causes: what
    is new first."""
    best = causes[0] if causes else None
    names = {f.name for f in findings}
    if best is None or not names or best.cause.name in names:
        return None
    if len(names) == 1 and not names & {"shape", "unknown"}:
        return None  # one name against another: the diagnosis has weighed them
    noise2 = left.noise**2
    first = findings[0]
    if _may_be_confused(best.cause, first):
        if best.new <= _explained_by(first, causes) + noise2:  # better by chance
            return None
    elif not explains_all(best, left):
        return None
    return best if _explains_most(best, left) else None


def explains_all(one: WeighedCause, left: ChangeResiduals) -> bool:
    """Whether nothing else is needed: it leaves no more than the model in use when all was well, or
    than all that the diagnosis found, but for the noise."""
    return one.left**2 <= max(left.found**2, _before(left)) + left.noise**2


def _explains_most(one: WeighedCause, left: ChangeResiduals) -> bool:
    before = max(_before(left), left.noise**2)
    new = left.in_use**2 - before
    return new > left.noise**2 and one.left**2 <= EXPLAINED * new + before


def _before(left: ChangeResiduals) -> float:
    """Mean square that the model in use left of the good recording; 0 where there is none."""
    return 0.0 if math.isnan(left.when_good) else left.when_good**2


def state_one_change(
    one: WeighedCause, causes: Sequence[WeighedCause], left: ChangeResiduals, first: Finding
) -> Finding:
    """That cause as what was found, with the names of those that do as well but for the noise, and
    the diagnosis' first finding where it may be confused with it."""
    noise2, cause = left.noise**2, one.cause
    near = [o.cause.name for o in causes if o.new >= one.new - noise2]
    near += [first.name] if _may_be_confused(cause, first) else []
    return Finding(
        name=cause.name,
        key=cause.name,
        place=cause.place,
        title=cause.says,
        equation="",
        source="",
        share=min(1.0, max(0.0, one.new / max(left.in_use**2 - noise2, 1e-300))),
        evidence={},
        parameters={},
        ambiguous_with=tuple(dict.fromkeys(n for n in near if n != cause.name)),
        where={},
        says=cause.says,
    )


def add_rivals(first: Finding, causes: Sequence[WeighedCause], left: ChangeResiduals) -> Finding:
    """The diagnosis' first finding, with the names of the causes that may be confused with it and
    alone explain as much of what is new, but for the noise and what the model in use leaves by
    itself, or more."""
    least = _explained_by(first, causes) - max(left.noise**2, OWN * _before(left))
    near = [
        o.cause.name
        for o in causes
        if o.new >= least and _explains_most(o, left) and _may_be_confused(o.cause, first)
    ]
    names = dict.fromkeys((*first.ambiguous_with, *near))
    return replace(first, ambiguous_with=tuple(n for n in names if n != first.name))


def _may_be_confused(cause: Cause, first: Finding) -> bool:
    named = cause.name in first.ambiguous_with or first.name in cause.confused_with
    return named and first.name != "shape"


def _explained_by(first: Finding, causes: Sequence[WeighedCause]) -> float:
    """What the finding's own cause alone removes of what is new [mean square]."""
    return max((o.new for o in causes if o.cause.name == first.name), default=0.0)


def off_the_gauge(
    model: Model, findings: Sequence[Finding], causes: Sequence[WeighedCause], noise2: float
) -> Model:
    """The model with what it has at the gauge of findings that may as well act elsewhere moved to
    there: what the gauge does is not compensated."""
    for one in findings:
        alike = [o.cause for o in _of_names(one, causes)]
        there = next((c.place for c in alike if c.place != "sensor"), "")
        if one.place != "sensor" or not there or is_of_sensor(one, causes, noise2):
            continue
        kinds = {b.kind for c in alike for b in c.model.blocks}
        moved = [b for b in model.blocks if b.place == "sensor" and b.kind in kinds]
        rest = tuple(b for b in model.blocks if b not in moved)
        blocks = [
            replace(b, place=there if there in KINDS[b.kind].places else "stage") for b in moved
        ]
        model = with_blocks(replace(model, blocks=rest), blocks)
    return model


def is_of_sensor(first: Finding, causes: Sequence[WeighedCause], noise2: float) -> bool:
    """Whether it is the gauge that has changed: elsewhere, neither a cause of that name nor one
    that it cannot be distinguished from does as well."""
    if first.place != "sensor":
        return False
    here = [o.new for o in causes if o.cause.name == first.name and o.cause.place == "sensor"]
    elsewhere = [one.new for one in _of_names(first, causes) if one.cause.place != "sensor"]
    return not elsewhere or max(elsewhere) < max(here, default=0.0) - noise2


def pick_models(first: Finding, causes: Sequence[WeighedCause], noise2: float) -> list[Model]:
    """What was named, then what it cannot be distinguished from where that does better by more than
    the noise; what a gauge does is not compensated."""
    fit = [o for o in _of_names(first, causes) if o.new > 0.0 and o.cause.place != "sensor"]
    named = [o for o in fit if o.cause.name == first.name]
    least = max((o.new + noise2 for o in named), default=0.0)
    return [o.cause.model for o in (*named, *(o for o in fit if o.new > least))]


def _of_names(first: Finding, causes: Sequence[WeighedCause]) -> list[WeighedCause]:
    return [o for o in causes if o.cause.name in (first.name, *first.ambiguous_with)]
