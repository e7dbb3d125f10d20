"""Check whether the gauge itself fails, before anything is concluded about the stage.

A recording whose readings are stuck, missing, jump or are outside the stage's reach gives no
information on the stage's physics, and no model may be identified from it.
"""

from typing import NamedTuple

import numpy as np

from dehyst.models.errors import DehystError
from dehyst.models.identify.validation import validate
from dehyst.models.model import Model
from dehyst.models.recording import Recording


class GaugeTuning(NamedTuple):
    """Judged by tests/benchmarks/daemon/second_act.py: no effect of a stage may be mistaken for a
    fault of its gauge."""

    missing: float = 0.2  # share of the rows without a reading
    same: float = 0.5  # share of the rows whose reading is that of the row before
    moved: float = 0.02  # share of its range that the drive must move in the meantime
    beyond: float = 0.5  # of the reach: distance outside it
    beyond_rows: float = 0.02
    jump: float = 0.2  # of the reach, from row to row and back
    jumps: int = 3
    noisier: float = 3.0  # times the noise that the model states
    white: float = 0.15  # autocorrelation of the residual, at the first lags
    lags: int = 10
    same_error: float = 1.5  # times the error on the good recording: still as good
    zero: float = 3.0  # times that error: the zero has moved
    line: float = 2.0  # times the rest of the error: error that is a straight line in time


GAUGE = GaugeTuning()


def find_gauge_fault(recording: Recording, model: Model, reach: tuple[float, float]) -> str:
    """Return the gauge's fault in words; "" where the readings are those of a working gauge. reach:
    least and largest displacement of the model."""
    y, missing = recording.displacement, recording.missing_displacement
    if y is None or not y.size:
        return "the gauge gives no reading"
    lost = float(np.mean(missing))
    if lost > GAUGE.missing:
        return f"the gauge gives no valid reading in {100 * lost:.0f} % of the rows"
    known, drive = y[~missing], recording.drive[~missing]
    low, high = min(reach), max(reach)
    span = max(high - low, 1e-12)
    far = (known < low - GAUGE.beyond * span) | (known > high + GAUGE.beyond * span)
    share = float(np.mean(far))
    if share > GAUGE.beyond_rows:
        value = known[far][0]
        return (
            f"the gauge reads far outside the reach in {100 * share:.0f} % of the rows, such as "
            f"{value:.4g} {model.displacement_unit}"
        )
    valid = model.validity
    # a drive that moves by less than 1e-4 of its range is at rest
    moved = np.abs(np.diff(drive)) > 1e-4 * (valid.drive_max - valid.drive_min)
    still = (np.diff(known) == 0.0) & moved
    if np.ptp(drive) > GAUGE.moved * (valid.drive_max - valid.drive_min):
        share = float(still.sum()) / max(1, int(moved.sum()))
        if share > GAUGE.same:
            return f"the gauge is stuck: the same reading in {100 * share:.0f} % of the rows"
    step = np.diff(known)
    there_and_back = (np.abs(step[:-1]) > GAUGE.jump * span) & (step[:-1] * step[1:] < 0.0)
    there_and_back &= np.abs(step[1:]) > 0.5 * GAUGE.jump * span  # and half of it back
    if int(there_and_back.sum()) >= GAUGE.jumps:
        return f"the gauge jumps: {int(there_and_back.sum())} times far away and back in one sample"
    return _find_noise(recording, model)


def _find_noise(recording: Recording, model: Model) -> str:
    """Return the fault of a reading that is noisier than it was: its residual is white and much
    larger."""
    stated = model.fit.noise_rms
    if not stated:
        return ""
    try:
        found = validate(model, recording)
    except DehystError:
        return ""
    white = float(np.abs(found.autocorrelation[: GAUGE.lags]).max()) < GAUGE.white
    if white and found.rms > GAUGE.noisier * stated:
        return (
            f"the gauge's reading is noisier: {found.rms:.3g} {model.displacement_unit} rms from "
            f"row to row, where it was {stated:.3g}"
        )
    return ""


def find_moved_zero(recording: Recording, model: Model, good: Recording | None) -> str:
    """Return, in words, whether the zero alone has moved or drifts; "" where it has not, or not
    alone. good: the last good recording."""
    if good is None:
        return ""
    try:
        now, then = validate(model, recording), validate(model, good)
    except DehystError:
        return ""
    assert recording.displacement is not None
    error = recording.displacement - now.predicted
    known = np.isfinite(error)
    t, e = recording.t_s[known], error[known]
    slope, _ = np.polyfit(t - t.mean(), e, 1)
    straight = float(np.std(e - slope * (t - t.mean())))
    as_good = GAUGE.same_error * max(then.rms, model.fit.noise_rms or 0.0)
    unit = model.displacement_unit
    if straight <= as_good and now.rms > GAUGE.line * straight:
        return f"The zero drifts by {slope:.3g} {unit}/s, and nothing else has changed"
    moved = now.offset - then.offset
    if now.rms <= as_good and abs(moved) > GAUGE.zero * as_good:
        return f"The zero has moved by {moved:.3g} {unit}, and nothing else has changed"
    return ""
