"""Run a model on a recording's drive and compare the two: what `dehyst simulate` does."""

from typing import NamedTuple

import numpy as np

from dehyst.models.cascade.history import replay_recording
from dehyst.models.errors import BadInput
from dehyst.models.model import Model
from dehyst.models.recording import Floats, Recording
from dehyst.models.signals.error_size import rms
from dehyst.models.units import how_many

ROUNDING = 1e-6  # share by which a drive may leave the validity and still count as inside


class Prediction(NamedTuple):
    """displacement: (N,) predicted by the model, NaN where the drive or a channel that the model
    reads is missing; start: the history assumed before the first row."""

    displacement: Floats
    start: str


def predict(model: Model, recording: Recording) -> Prediction:
    """Run the model on the recording's drive. If the recording has a displacement, the run starts
    with the history that fits it (dehyst.models.cascade.history), otherwise de-energised.

    The play operators skip missing rows; nothing is interpolated. Raises BadInput on other units or
    missing channels.
    """
    if model.drive_unit != recording.drive_unit:
        raise BadInput(
            f"{recording.name}: the drive is in {recording.drive_unit}, the model's in "
            f"{model.drive_unit}"
        )
    start, out = replay_recording(model, recording)
    return Prediction(out, start)


def outside_validity(model: Model, recording: Recording) -> dict[str, float]:
    """Return the share of rows outside the model's drive range and the share outside its rate
    range."""
    v, u = model.validity, recording.drive
    margin = ROUNDING * (v.drive_max - v.drive_min)
    with np.errstate(invalid="ignore"):
        drive = (u < v.drive_min - margin) | (u > v.drive_max + margin)
        rate = np.abs(np.diff(u)) / np.diff(recording.t_s)
        fast = rate > v.rate_max * (1 + ROUNDING) if v.rate_max else np.zeros(1, dtype=bool)
    return {"drive": float(np.mean(drive)), "rate": float(np.mean(fast)) if fast.size else 0.0}


SAME = 0.02
"""Two rms errors are both reported only if they differ by at least this fraction."""


class Misfit(NamedTuple):
    """Measured minus model: rms over all rows that have both, and the number of these rows; then
    the same for rows from `from_s` on (see `settled_row`), NaN and 0 if there are none. offset:
    mean over all rows, such as another zero of the gauge; rms_without_offset,
    rms_settled_without_offset: about the mean of the same rows, as in diagnosis.json."""

    rms: float
    rows: int
    from_s: float
    rms_settled: float
    rows_settled: int
    offset: float
    rms_without_offset: float
    rms_settled_without_offset: float


def misfit(model: Model, recording: Recording, y: Floats) -> Misfit | None:
    """Return the error of y (N,) against the recording; None without a measured displacement in the
    model's unit, or if no row has both."""
    if recording.displacement_unit != model.displacement_unit or recording.displacement is None:
        return None
    error = recording.displacement - y
    known = ~np.isnan(error)
    if not known.any():
        return None
    first = settled_row(model, recording)
    late = known & (np.arange(recording.size) >= first)
    return Misfit(
        rms(error[known]),
        int(np.count_nonzero(known)),
        float(recording.t_s[first]) if first < recording.size else float("nan"),
        rms(error[late]),
        int(np.count_nonzero(late)),
        float(np.mean(error[known])),
        float(np.std(error[known])),
        float(np.std(error[late])) if late.any() else float("nan"),
    )


def settled_row(model: Model, recording: Recording) -> int:
    """Return the first row at which no play operator still depends on the state of the stage before
    the recording; the number of rows if there is none.

    A play operator of threshold r has forgotten its initial state once its drive has covered 2 r.
    """
    h = model.hysteresis
    travel = 2.0 * float(h.r[(h.b != 0) | (h.k != 0)].max(initial=0.0))
    u = np.where(recording.missing_drive, np.nan, recording.drive)
    covered = np.fmax.accumulate(u) - np.fmin.accumulate(u)
    enough = np.flatnonzero(covered >= travel)
    return int(enough[0]) if enough.size else recording.size


def describe_misfit(error: Misfit, unit: str) -> str:
    """Return the error as text, with the rows over which it was computed."""
    rows = how_many(error.rows, "row")
    whole = f"{error.rms:.4g} {unit} rms over {rows if error.rows == 1 else f'all {rows}'}"
    if error.rms_without_offset < (1.0 - SAME) * error.rms:
        whole += (
            f" ({error.rms_without_offset:.4g} {unit} without its mean of {error.offset:.4g} "
            f"{unit}, perhaps because the gauge had another zero)"
        )
    if not error.rows_settled:
        return f"{whole}; all of them depend on the unknown earlier state of the stage"
    if abs(error.rms_settled - error.rms) < SAME * error.rms:
        return whole
    return (
        f"{whole}; {error.rms_settled:.4g} {unit} rms over the {error.rows_settled} from "
        f"{error.from_s:.4g} s on, which no longer depend on the state of the stage before the "
        "first"
    )
