"""Examine one case: is the gauge at fault, which effects does the model lack, is a better model
available, and which experiment comes next?

The flagged recording, with its lead-in, is diagnosed against the model in use. The last good
recording is the control: the residual of the model on it shows whether the effects found are new.
The two are not diagnosed together, because the change is present in only one of them, and a
diagnosis names only what both share. In addition to the diagnosis, each cause is tried alone,
because usually only one thing has changed.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import msgspec
import numpy as np

from dehyst.daemon import clock
from dehyst.daemon.api.results import Diagnosed
from dehyst.daemon.bus.messages import FoundEffect
from dehyst.daemon.doctor.next_step import excite_arguments
from dehyst.daemon.files import cases
from dehyst.daemon.files.cases import Case, Examined, OfferTest
from dehyst.daemon.files.models import load_model, save_model
from dehyst.daemon.files.recordings import read_recording
from dehyst.models import diagnosis
from dehyst.models.cascade.reach import displacement_range
from dehyst.models.change.causes import WeighedCause, find_causes, weigh_causes
from dehyst.models.change.lead import blank_lead, drop_lead
from dehyst.models.change.naming import (
    ChangeResiduals,
    add_rivals,
    explains_all,
    find_one_change,
    is_of_sensor,
    leaves_nothing_new,
    move_sensor_blocks,
    pick_models,
    rank_findings,
    state_one_change,
)
from dehyst.models.change.replay import ReplayComparison, keep_zero, replay_both
from dehyst.models.diagnosis import Finding
from dehyst.models.errors import BadInput, DehystError
from dehyst.models.identify.validation import validate
from dehyst.models.inverse.compensator import Compensator
from dehyst.models.mismatch.gauge import find_gauge_fault, find_moved_zero
from dehyst.models.model import Model
from dehyst.models.physics import split_off_one_recording
from dehyst.models.recording import Recording

GAUGE = "gauge"
SPARE_S = 60.0
"""Time to wait for the later telemetry after it is due."""
LOOK_S = 0.25  # interval at which this file is looked for
NEW, LEAST = 0.8, 0.1
"""NEW: an effect is new if the earlier residual is below this fraction of the present one; LEAST:
fraction of the residual's mean square that a cause must remove."""
SPARSER = 0.5
"""Noise rms, as a multiple, that a richer model must remove beyond the sparser one."""


@dataclass(frozen=True)
class _Evidence:
    """later: None if it has not arrived; good: None if there is none; causes: newest first."""

    flagged: Recording
    later: Recording | None
    good: Recording | None
    causes: Sequence[WeighedCause]


def examine(folder: Path) -> Examined:
    """Return the doctor's result for one case. Raises DehystError if it cannot be diagnosed."""
    case = cases.get_record(folder, cases.CASE, Case)
    if case is None:
        raise BadInput(f"{folder.name}: no case")
    model = load_model(folder / cases.IN_USE)
    whole = read_recording(folder / cases.FLAGGED, need_displacement=True, min_rows=1)
    lead_s = case.leads.get(cases.FLAGGED, 0.0)
    valid = model.validity
    reach = displacement_range(model, valid.drive_min, valid.drive_max)
    fault = "the gauge is stuck" if case.figure == "stuck" else ""
    fault = find_gauge_fault(drop_lead(whole, lead_s), model, reach) or fault
    if fault:
        return Examined(
            verdict=GAUGE,
            says=f"{fault[0].upper()}{fault[1:]}: no model is offered. Check the gauge and its "
            "reader first.",
            unit=model.displacement_unit,
        )
    flagged, good = blank_lead(whole, lead_s), _read(folder, cases.GOOD, case)
    moved = find_moved_zero(flagged, model, good)
    if moved:
        return Examined(
            verdict=GAUGE,
            says=f"{moved}: no model is offered. The gauge or its mount has moved; the trim "
            "follows this within its limit, and `dehyst zero` sets the zero.",
            unit=model.displacement_unit,
        )
    found = Diagnosed(diagnosis.diagnose([flagged], model, with_limits=False), (flagged,))
    unwritten = _save(found, folder)
    examined = _conclude(folder, case, model, found, _gather(folder, case, model, flagged, good))
    return msgspec.structs.replace(examined, says=f"{examined.says}{unwritten}"[:2000])


def _save(found: Diagnosed, folder: Path) -> str:
    """Write the report; return a sentence with the reason if it cannot be written: the findings are
    kept without it."""
    try:
        found.save(folder / cases.FOUND)
    except (ArithmeticError, LookupError, TypeError, ValueError, MemoryError) as error:
        return f" The report could not be written ({str(error) or type(error).__name__})."
    return ""


def _gather(
    folder: Path, case: Case, model: Model, flagged: Recording, good: Recording | None
) -> _Evidence:
    causes = find_causes(model, flagged)
    later = _wait_for_later(folder, case)
    weighed = weigh_causes(model, causes, flagged if later is None else later, good)
    return _Evidence(flagged, later, good, weighed)


def _conclude(
    folder: Path, case: Case, model: Model, found: Diagnosed, seen: _Evidence
) -> Examined:
    details = found.details
    before, after = details.before_after
    when_good = validate(model, seen.good).rms if seen.good is not None else -1.0
    noise2 = details.noise**2
    findings = rank_findings(details.findings, seen.causes, LEAST * before**2, noise2)
    verdict, models, report_text = details.verdict, [found.model], ""
    left = _left(model, found.model, when_good, details.noise, seen)
    one = find_one_change(findings, seen.causes, left)
    if one is not None:  # it alone explains all or most of what is new
        whole = explains_all(one, left)
        report_text = _describe_report(findings, whole)
        findings = [state_one_change(one, seen.causes, left, findings[0])]
        verdict, models = "explained", [] if whole else models
    elif findings:
        report_text = _describe_company(findings, seen.causes, left)
        findings = [add_rivals(findings[0], seen.causes, left), *findings[1:]]
    named = [f for f in findings if f.name != "unknown"]
    of_sensor = bool(named) and is_of_sensor(named[0], seen.causes, noise2)
    offered, tested, why = None, None, ""
    if of_sensor:
        why = "The gauge has changed, so no model is offered."
    elif named and seen.later is None:
        why = "No model is offered, because no telemetry arrived on which it could be tested."
    elif named and seen.later is not None:
        models = [move_sensor_blocks(m, model, named, seen.causes, noise2) for m in models]
        models = [*pick_models(named[0], seen.causes, noise2), *models]
        offered, tested, why = try_models(case, model, models, seen.later, details.noise)
    if offered is not None:
        save_model(offered, folder / cases.OFFERED)
        after = validate(offered, seen.flagged).rms
    says = [
        _describe_findings(findings, verdict, (before, after, details.unit), offered is not None),
        *_describe_when_good(when_good, before, details.unit),
        *(text for text in (report_text, why) if text),
    ]
    unsure = tested is None and not of_sensor and verdict != "clean"
    pair = next(((f.name, other) for f in named[:1] for other in f.ambiguous_with), None)
    return Examined(
        verdict=verdict,
        says=" ".join(says)[:2000],
        effects=tuple(_effect(f) for f in findings[:32]),
        unit=details.unit,
        noise=details.noise,
        rms_in_use=before,
        rms_augmented=after,
        rms_when_good=when_good,
        tested=tested,
        experiment=excite_arguments(case, model, pair) if unsure else (),
    )


def _effect(finding: Finding) -> FoundEffect:
    return FoundEffect(
        name=finding.name,
        acts_on=finding.place or "stage",
        share=float(np.nan_to_num(finding.share)),
        ambiguous_with=finding.ambiguous_with,
        says=finding.says[:2000],
    )


def _describe_when_good(when_good: float, before: float, unit: str) -> list[str]:
    """Describe the residual on the last good recording."""
    if when_good < 0.0:
        return []
    left = f"the model in use left {when_good:.3g} {unit} of the last good recording"
    if when_good < NEW * before:
        return [f"It is new: {left}."]
    return [f"It is not new: {left}, too."]


def _describe_findings(
    findings: Sequence[Finding], verdict: str, left: tuple[float, float, str], offered: bool
) -> str:
    """Describe the findings. left: rms residuals of the model in use and of the offered (or else
    the augmented) model, and their unit."""
    before, after, unit = left
    names = ", ".join(dict.fromkeys(f.name for f in findings)) or "nothing"
    explained = "partly explained" if verdict == "partly" else verdict
    text = f"Found: {names} ({explained}); {before:.3g} {unit} rms with the model in use"
    if offered or after < before:
        which = "the offered model" if offered else "the findings added"
        text += f", {after:.3g} with {which}"
    return f"{text}."


def _describe_report(findings: Sequence[Finding], whole: bool) -> str:
    """Describe what the report finds when a single change suffices; whole: the change explains
    everything."""
    names = ", ".join(dict.fromkeys(f.name for f in findings)) or "nothing"
    says = "It is a single change" if whole else "Alone it explains most of what is new"
    return f"{says}; the report, which fits the loop again, shows it as {names}."


def _describe_company(
    findings: Sequence[Finding], causes: Sequence[WeighedCause], left: ChangeResiduals
) -> str:
    """Describe the further findings if the first alone explains all that is new; else ""."""
    known = {findings[0].name, "unknown"}
    others = dict.fromkeys(f.name for f in findings[1:] if f.name not in known)
    if not others or not leaves_nothing_new(findings[0], causes, left):
        return ""
    return (
        f"The {findings[0].name} alone explains all that is new. The report attributes what the "
        f"model in use had left before to {', '.join(others)}."
    )


def _left(
    in_use: Model, all_found: Model, when_good: float, noise: float, seen: _Evidence
) -> ChangeResiduals:
    recording = seen.flagged if seen.later is None else seen.later
    try:
        found = validate(all_found, recording).rms
    except BadInput:
        found = 0.0
    good = when_good if seen.good is not None else math.nan
    return ChangeResiduals(validate(in_use, recording).rms, good, found, noise)


def _read(folder: Path, name: str, case: Case) -> Recording | None:
    try:
        one = read_recording(folder / name, need_displacement=True)
    except DehystError:
        return None
    return blank_lead(one, case.leads.get(name, 0.0))


def try_models(
    case: Case, model: Model, models: Sequence[Model], later: Recording, noise: float
) -> tuple[Model | None, OfferTest | None, str]:
    """Return (the model that did best on the later telemetry, without its blocks that describe this
    recording only; its test; the reason if none is offered)."""
    tried: list[tuple[ReplayComparison, Model]] = []
    why, left_out = "", dict[str, None]()
    for one in models:
        to_run, blocks = split_off_one_recording(one)
        left_out |= dict.fromkeys(blocks)
        try:
            candidate = keep_zero(model, to_run, later)
            Compensator(candidate, 1.0 / case.rate_hz, case.low, case.high, case.slew)
            tried.append((replay_both(model, candidate, later, noise, case.later_s), candidate))
        except (DehystError, ValueError, ArithmeticError) as error:
            why = f"No model is offered, because the augmented one cannot be used here ({error})."
    if not tried:
        return None, None, why
    best, offered = tried[0]
    for both, candidate in tried[1:]:  # a richer model must improve by more than noise
        if best.offered**2 - both.offered**2 > (SPARSER * both.noise) ** 2:
            best, offered = both, candidate
    if not best.improves:
        names = ", ".join(left_out)
        unit = model.displacement_unit
        return (
            None,
            None,
            (
                "No model is offered: on later telemetry the augmented model leaves "
                f"{best.offered:.3g} {unit} and the model in use {best.in_use:.3g}; the "
                "improvement does not exceed the noise."
                + (f" Blocks that describe this recording only, not run: {names}." if names else "")
            ),
        )
    test = OfferTest(
        in_use=best.in_use,
        offered=best.offered,
        noise=best.noise,
        seconds=best.seconds,
        blocks=tuple(b.kind for b in offered.blocks),
    )
    return offered, test, ""


def _wait_for_later(folder: Path, case: Case) -> Recording | None:
    """Return the telemetry that follows the recording once it is complete; None if it does not
    arrive."""
    for _ in range(round((case.later_s + SPARE_S) / LOOK_S)):
        if (folder / cases.LATER).exists():
            return _read(folder, cases.LATER, case)
        clock.sleep_s(LOOK_S)
    return None
