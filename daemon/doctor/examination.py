"""One case: is it the gauge? What was left out? Is a better model at hand? What is to be tried?

The flagged recording is diagnosed, about the model in use. The last good recording is the control:
what the model left of it says whether what was found is new. Both are not diagnosed as one, because
what has changed is not the same in both, and a diagnosis names only what is.
"""

from dataclasses import replace
from pathlib import Path

import numpy as np

from dehyst.daemon import clock
from dehyst.daemon.api.results import Diagnosed
from dehyst.daemon.bus.messages import FoundEffect
from dehyst.daemon.doctor.next_step import excite_arguments
from dehyst.daemon.files import cases
from dehyst.daemon.files.cases import Case, Examined, OfferTest
from dehyst.daemon.files.models import load_model, save_model
from dehyst.daemon.files.recordings import read_recording
from dehyst.daemon.loop.reach import displacement_range
from dehyst.models import diagnosis
from dehyst.models.errors import BadInput, DehystError
from dehyst.models.identify.validation import validate
from dehyst.models.inverse.compensator import Compensator
from dehyst.models.mismatch.gauge import find_gauge_fault
from dehyst.models.mismatch.replay import BothReplayed, replay_both
from dehyst.models.model import Model
from dehyst.models.recording import Recording

GAUGE = "gauge"
SPARE_S = 60.0
"""So long beyond its due time the later telemetry is waited for."""
LOOK_S = 0.25
SHAPES = ("shape", "memory")
SPARSER = 0.5
"""Noises rms that a richer model must remove beyond the sparser one."""


def examine(folder: Path) -> Examined:
    """What the doctor says of one case. Raises DehystError where it cannot be diagnosed."""
    case = cases.get_record(folder, cases.CASE, Case)
    if case is None:
        raise BadInput(f"{folder.name}: no case")
    model = load_model(folder / cases.IN_USE)
    flagged = read_recording(folder / cases.FLAGGED, need_displacement=True, min_rows=1)
    valid = model.validity
    reach = displacement_range(model, valid.drive_min, valid.drive_max)
    fault = "the gauge is stuck" if case.figure == "stuck" else ""
    fault = find_gauge_fault(flagged, model, reach) or fault
    if fault:
        return Examined(
            verdict=GAUGE,
            says=f"{fault[0].upper()}{fault[1:]}: no model is offered. Look at the gauge and its "
            "reader first.",
            unit=model.displacement_unit,
        )
    found = Diagnosed(diagnosis.diagnose([flagged], model), (flagged,))
    found.save(folder / cases.FOUND)
    return _conclude(folder, case, model, found, flagged)


def _conclude(
    folder: Path, case: Case, model: Model, found: Diagnosed, flagged: Recording
) -> Examined:
    details = found.details
    before, after = details.before_after
    named = [f for f in details.findings if f.name != "unknown"]
    when_good = _left_when_good(folder, model)
    says = [_tell(found, before, after)]
    if when_good >= 0.0:
        unit = details.unit
        says.append(
            f"In the last good recording the model in use left {when_good:.3g} {unit}."
            if when_good < 0.8 * before
            else f"But the model in use left {when_good:.3g} {unit} of the last good recording, "
            "too: it is not new."
        )
    of_sensor = bool(named) and named[0].place == "sensor"
    offered, tested, why = None, None, ""
    if of_sensor:
        why = "What has changed is the gauge: no model is offered."
    elif case.figure == "offset" and before <= 2.0 * max(when_good, details.noise):
        why = "The zero has moved, and nothing else: no model is offered. `dehyst zero` sets it."
    elif named:
        offered, tested, why = _try(folder, case, model, found)
    if offered is not None:
        save_model(offered, folder / cases.OFFERED)
    if why:
        says.append(why)
    unsure = tested is None and not of_sensor and details.verdict != "clean"
    pair = next(((f.name, other) for f in named[:1] for other in f.ambiguous_with), None)
    return Examined(
        verdict=details.verdict,
        says=" ".join(says)[:2000],
        effects=tuple(
            FoundEffect(
                name=f.name,
                acts_on=f.place or "stage",
                share=float(np.nan_to_num(f.share)),
                ambiguous_with=f.ambiguous_with,
                says=f.says[:2000],
            )
            for f in details.findings[:32]
        ),
        unit=details.unit,
        noise=details.noise,
        rms_in_use=before,
        rms_augmented=after,
        rms_when_good=when_good,
        tested=tested,
        experiment=excite_arguments(case, model, pair) if unsure else (),
    )


def _tell(found: Diagnosed, before: float, after: float) -> str:
    details = found.details
    names = ", ".join(f.name for f in details.findings) or "nothing"
    pair = f"{before:.3g} {details.unit} rms with the model in use, {after:.3g} with what was found"
    return f"Found: {names} ({details.verdict}); {pair}."


def _left_when_good(folder: Path, model: Model) -> float:
    """What the model in use left of the last good recording; below 0: there is none."""
    try:
        good = read_recording(folder / cases.GOOD, need_displacement=True, min_rows=1)
        return validate(model, good).rms
    except DehystError:
        return -1.0


def _try(
    folder: Path, case: Case, model: Model, found: Diagnosed
) -> tuple[Model | None, OfferTest | None, str]:
    """(the model that did best on what came later, its test, why none is offered)."""
    later = _wait_for_later(folder, case)
    if later is None:
        return None, None, "No model is offered: no telemetry came on which it could be tested."
    tried: list[tuple[BothReplayed, Model]] = []
    why = ""
    for candidate in _candidates(model, found.model):
        try:
            Compensator(candidate, 1.0 / case.rate_hz, case.low, case.high, case.slew)
            tried.append((replay_both(model, candidate, later, found.details.noise), candidate))
        except (DehystError, ValueError, ArithmeticError) as error:
            why = f"No model is offered: the augmented one cannot be used here ({error})."
    if not tried:
        return None, None, why
    best, offered = tried[0]
    for both, candidate in tried[1:]:  # a richer one has to earn it
        if best.offered**2 - both.offered**2 > (SPARSER * both.noise) ** 2:
            best, offered = both, candidate
    if not best.improves:
        return None, None, _why_not(best, found)
    test = OfferTest(
        in_use=best.in_use,
        offered=best.offered,
        noise=best.noise,
        seconds=best.seconds,
        blocks=tuple(b.kind for b in offered.blocks),
    )
    return offered, test, ""


def _candidates(model: Model, augmented: Model) -> list[Model]:
    """The model in use with the physics alone, and the augmented model with the loop's new shape,
    which is only known where the recording was."""
    physics = tuple(b for b in augmented.blocks if b.kind not in SHAPES)
    alone = replace(augmented, hysteresis=model.hysteresis, blocks=physics)
    return [alone, augmented] if physics != augmented.blocks and physics else [augmented]


def _why_not(both: BothReplayed, found: Diagnosed) -> str:
    return (
        f"No model is offered: on later telemetry the augmented one leaves {both.offered:.3g} "
        f"{found.details.unit}, the one in use {both.in_use:.3g}; that is within the noise."
    )


def _wait_for_later(folder: Path, case: Case) -> Recording | None:
    """The telemetry behind the recording, once it is complete; None: it does not come."""
    for _ in range(round((case.later_s + SPARE_S) / LOOK_S)):
        if (folder / cases.LATER).exists():
            try:
                return read_recording(folder / cases.LATER, need_displacement=True)
            except DehystError:
                return None
        clock.sleep_s(LOOK_S)
    return None
