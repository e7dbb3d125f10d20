"""One case as the message that clients get."""

from dehyst.daemon.bus.messages import DoctorReport, DoctorState, ModelOffer
from dehyst.daemon.files.cases import Case, Decided, Examined


def describe_report(
    case: Case, examined: Examined | None, decided: Decided | None, trial_s: float
) -> DoctorReport:
    """examined: None: the doctor is at work; decided: None: nobody has decided yet."""
    if examined is None:
        return DoctorReport(
            case=case.name,
            time_ns=case.time_ns,
            wall_ns=case.wall_ns,
            changed_wall_ns=case.wall_ns,
            state="working",
            says="The doctor has the recording.",
        )
    tested, offer = examined.tested, None
    if tested is not None:
        offer = ModelOffer(
            number=case.number,
            seconds=tested.seconds,
            rms_in_use=tested.in_use,
            rms_offered=tested.offered,
            noise=tested.noise,
            trial_s=trial_s,
            blocks=tested.blocks,
        )
    state: DoctorState = "failed" if examined.failed else "found"
    says = examined.says
    if decided is not None:
        state = decided.state
        says = f"{says} {decided.because[0].upper()}{decided.because[1:]}."
    return DoctorReport(
        case=case.name,
        time_ns=case.time_ns,
        wall_ns=case.wall_ns,
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
