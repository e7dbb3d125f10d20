"""Turns a case into the message that clients receive."""

from typing import NamedTuple

import msgspec

from dehyst.daemon.bus.messages import DoctorReport, DoctorState, ModelOffer
from dehyst.daemon.files.cases import Case, Decided, Examined


class Scope(NamedTuple):
    """Limits of a model on an axis: reach [displacement unit] and largest known rate [drive unit /
    s], None: unknown."""

    reach: tuple[float, float]
    rate: float | None


Scopes = tuple[Scope, Scope]
"""Limits of the model in use and of the offered one."""


def describe_scopes(scopes: Scopes, unit: str) -> str:
    """Describe in words how accepting changes the reach and the rate."""
    (before, fast), (after, faster) = scopes
    text = f"the reach of {before[0]:.4g} to {before[1]:.4g} {unit} becomes "
    text += f"{after[0]:.4g} to {after[1]:.4g} {unit}"
    if fast == faster:
        return text
    words = ["unlimited" if rate is None else f"{rate:.4g}" for rate in (fast, faster)]
    return f"{text}, the largest drive rate of {words[0]} becomes {words[1]}"


def describe_report(
    case: Case,
    examined: Examined | None,
    decided: Decided | None,
    times: tuple[float, float],
    scopes: Scopes | None = None,
) -> DoctorReport:
    """Return the report of a case. examined: None: the doctor is still working; decided: None: no
    decision yet; times: of a trial [s], required motion and time limit; scopes: None: unknown."""
    begun = DoctorReport(
        case=case.name,
        time_ns=case.time_ns,
        wall_ns=case.wall_ns,
        changed_wall_ns=case.wall_ns,
        state="working",
        says="The doctor has the recording.",
    )
    if examined is None:
        return begun
    tested, offer = examined.tested, None
    if tested is not None:
        offer = ModelOffer(
            number=case.number,
            seconds=tested.seconds,
            rms_in_use=tested.in_use,
            rms_offered=tested.offered,
            noise=tested.noise,
            trial_s=times[0],
            trial_limit_s=times[1],
            blocks=tested.blocks,
        )
        if scopes is not None:
            in_use, offered = scopes
            offer = msgspec.structs.replace(
                offer,
                reach_in_use=in_use.reach,
                reach_offered=offered.reach,
                rate_in_use=in_use.rate,
                rate_offered=offered.rate,
            )
    state: DoctorState = "failed" if examined.failed else "found"
    says = examined.says
    if decided is not None:
        state = decided.state
        says = f"{says} {decided.because[0].upper()}{decided.because[1:]}."
    return msgspec.structs.replace(
        begun,
        changed_wall_ns=decided.wall_ns if decided is not None else case.wall_ns,
        state=state,
        verdict=examined.verdict,
        says=says[:2000],
        effects=examined.effects,
        unit=examined.unit,
        noise=examined.noise,
        rms_in_use=examined.rms_in_use,
        rms_augmented=examined.rms_augmented,
        rms_when_good=examined.rms_when_good,
        has_report=not examined.failed and bool(examined.effects or examined.rms_in_use),
        offer=offer,
        experiment=examined.experiment,
    )
