"""Decide what to report: the diagnosis' findings, the newest effect first, or a single change.

A diagnosis refits the loop's shape together with each cause. The shape can absorb the effect of a
cause, which is then not found. If a single change to the model in use leaves no larger residual on
later telemetry than that model left while it was right, nothing else is needed.
"""

import math
from collections.abc import Sequence
from dataclasses import replace
from typing import NamedTuple

from dehyst.models.change.causes import Cause, WeighedCause
from dehyst.models.diagnosis import Finding
from dehyst.models.model import Model
from dehyst.models.physics import KINDS, with_blocks

EXPLAINED = 0.15  # largest fraction of the new power that a single change may leave
WEAK = 0.25  # a change removes at least this fraction of what the best cause alone removes
OWN = 0.5  # fraction of the power that the model left while right, which may favour either of two


class ChangeResiduals(NamedTuple):
    """rms residuals. in_use: of the model in use on later telemetry; when_good: on the good
    recording (NaN: none); found: on later telemetry after all that the diagnosis found; noise."""

    in_use: float
    when_good: float
    found: float
    noise: float


def rank_findings(
    findings: Sequence[Finding], causes: Sequence[WeighedCause], least: float, noise2: float
) -> list[Finding]:
    """Return the findings, the newest effect first: by the mean square that a finding's cause alone
    removes from later telemetry and not from the good recording; among those within noise2 of the
    best, by the diagnosis' share. The loop's shape follows, then findings that remove less than
    `least` or than the fraction WEAK of what the best cause removes, then the unexplained rest."""
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
    """Return the single cause to report in place of the findings, or None. It explains all that is
    new, is not named by the diagnosis, and the diagnosis needs several names or a shape; or it
    explains most of what is new, and more than the effect that the diagnosis names first and with
    which it may be confused. findings, causes: the newest effect first."""
    best = causes[0] if causes else None
    names = {f.name for f in findings}
    if best is None or not names or best.cause.name in names:
        return None
    if len(names) == 1 and not names & {"shape", "unknown"}:
        return None  # one name against another: the diagnosis has compared them
    noise2 = left.noise**2
    first = findings[0]
    if _may_be_confused(best.cause, first):
        if leaves_nothing_new(first, causes, left):
            return None
        if best.new <= _explained_by(first, causes) + noise2:  # better by chance
            return None
    elif not explains_all(best, left):
        return None
    return best if _explains_most(best, left) else None


def explains_all(one: WeighedCause, left: ChangeResiduals) -> bool:
    """Return whether nothing else is needed: within the noise, the cause leaves no more than the
    model in use left while it was right, or than all that the diagnosis found."""
    return one.left**2 <= max(left.found**2, _before(left)) + left.noise**2


def leaves_nothing_new(
    first: Finding, causes: Sequence[WeighedCause], left: ChangeResiduals
) -> bool:
    """Return whether a cause of the finding's own name leaves no more than the model in use left
    while it was right, so that the other findings describe what it left then."""
    before = _before(left)
    return any(o.cause.name == first.name and o.left**2 <= before for o in causes)


def _explains_most(one: WeighedCause, left: ChangeResiduals) -> bool:
    before = max(_before(left), left.noise**2)
    new = left.in_use**2 - before
    return new > left.noise**2 and one.left**2 <= EXPLAINED * new + before


def _before(left: ChangeResiduals) -> float:
    """Return the mean square residual of the model in use on the good recording; 0 without one."""
    return 0.0 if math.isnan(left.when_good) else left.when_good**2


def state_one_change(
    one: WeighedCause, causes: Sequence[WeighedCause], left: ChangeResiduals, first: Finding
) -> Finding:
    """Return the cause as a finding, ambiguous with the causes that do as well within the noise,
    and with the diagnosis' first finding if they may be confused."""
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
    """Return the diagnosis' first finding, ambiguous also with the causes that may be confused with
    it and that alone explain at least as much of what is new, within the noise and a part OWN of
    the residual of the model in use."""
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
    """Return the new mean square that the cause of the finding's name removes alone."""
    return max((o.new for o in causes if o.cause.name == first.name), default=0.0)


def move_sensor_blocks(
    model: Model,
    in_use: Model,
    findings: Sequence[Finding],
    causes: Sequence[WeighedCause],
    noise2: float,
) -> Model:
    """Return the model with new sensor blocks, which the model in use lacks, moved where a cause of
    their finding acts too, since sensor blocks are not compensated: there if that cause does as
    well, else to the stage, which changes nothing of what the model predicts. Only for a change
    that is not the sensor's (`is_of_sensor`): the sensor then still reads as it did before."""
    for one in findings:
        alike = [o.cause for o in _of_names(one, causes)]
        elsewhere = [c for c in alike if c.place != "sensor"]
        if one.place != "sensor" or not elsewhere:
            continue
        kinds = {b.kind for c in alike for b in c.model.blocks}
        new = [b for b in model.blocks if b not in in_use.blocks]
        moved = [b for b in new if b.place == "sensor" and b.kind in kinds]
        if is_of_sensor(one, causes, noise2):
            elsewhere = []
        rest = tuple(b for b in model.blocks if b not in moved)
        blocks = [replace(b, place=_place_of(b.kind, elsewhere)) for b in moved]
        model = with_blocks(replace(model, blocks=rest), blocks)
    return model


def _place_of(kind: str, causes: Sequence[Cause]) -> str:
    """Return where the first cause with a block of this kind acts; without one, the stage."""
    places = (c.place for c in causes if any(b.kind == kind for b in c.model.blocks))
    return next((place for place in places if place in KINDS[kind].places), "stage")


def is_of_sensor(first: Finding, causes: Sequence[WeighedCause], noise2: float) -> bool:
    """Return whether the sensor has changed: in other places no cause of that name, and none that
    cannot be distinguished from it, does as well."""
    if first.place != "sensor":
        return False
    here = [o.new for o in causes if o.cause.name == first.name and o.cause.place == "sensor"]
    elsewhere = [one.new for one in _of_names(first, causes) if one.cause.place != "sensor"]
    return not elsewhere or max(elsewhere) < max(here, default=0.0) - noise2


def pick_models(first: Finding, causes: Sequence[WeighedCause], noise2: float) -> list[Model]:
    """Return the models of the named cause, then those of causes that cannot be distinguished from
    it and do better by more than the noise. Sensor effects are not compensated and are left out."""
    fit = [o for o in _of_names(first, causes) if o.new > 0.0 and o.cause.place != "sensor"]
    named = [o for o in fit if o.cause.name == first.name]
    least = max((o.new + noise2 for o in named), default=0.0)
    return [o.cause.model for o in (*named, *(o for o in fit if o.new > least))]


def _of_names(first: Finding, causes: Sequence[WeighedCause]) -> list[WeighedCause]:
    return [o for o in causes if o.cause.name in (first.name, *first.ambiguous_with)]
