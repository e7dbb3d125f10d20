"""Identification: recordings in, an invertible model out."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.optimize import lsq_linear

from dehyst.models.errors import BadRecording
from dehyst.models.forward import simulate
from dehyst.models.model import Fit, Hysteresis, Model, Provenance, Validity
from dehyst.models.play import play_matrix
from dehyst.models.recording import Floats, Recording


@dataclass(frozen=True)
class Options:
    """What the user fixed; None: chosen by hold-out."""

    order: int | None = None
    rate: bool | None = None
    saturation: int | None = None
    bias: bool | None = None


@dataclass(frozen=True)
class Identification:
    """The model and what is known of its worth."""

    model: Model


def cubic_thresholds(n: int, drive_span: float) -> Floats:
    """(n,) thresholds, fine at small and coarse at large values, from 0 (after Eq. 10)."""
    return (np.arange(n) / n) ** 3 * drive_span / 2.0


def identify(recordings: Sequence[Recording], options: Options | None = None) -> Identification:
    """A static monotone model with cubic thresholds, by bounded linear least squares."""
    options = options or Options()
    rec = recordings[0]
    if rec.displacement is None:
        raise BadRecording(f"{rec.name}: no displacement column (y_um, ...)")
    keep = ~(rec.missing_drive | rec.missing_displacement)
    u, y = rec.drive[keep], rec.displacement[keep]
    if u.size < 10 or np.ptp(u) == 0 or np.ptp(y) == 0:
        raise BadRecording(f"{rec.name}: nothing moves; drive the stage through its range")
    r = cubic_thresholds(options.order or 10, float(np.ptp(u)))
    offset = 0.0 if abs(u[0]) <= 0.02 * np.ptp(u) else float(u[0])
    plays = play_matrix(r, u - offset, np.zeros(r.size))
    columns = np.c_[plays[:, :-1] - plays[:, 1:], plays[:, -1], np.ones(u.size)]
    slope = np.ptp(y) / np.ptp(u)
    low = np.r_[np.full(r.size, 0.01 * slope), -np.inf]
    x = lsq_linear(columns, y, bounds=(low, np.inf)).x
    b = np.diff(x[:-1], prepend=0.0)
    hysteresis = Hysteresis(r=r, b=b, c=[x[-1], 1.0], u_offset=offset)
    rms = float(np.std(y - simulate(hysteresis, u, rec.period_s)))
    model = Model(
        hysteresis,
        Validity(float(u.min()), float(u.max()), period_s=rec.period_s),
        rec.drive_unit,
        rec.displacement_unit,
        fit=Fit(rms=rms),
        provenance=Provenance(source="dehyst identify", recordings=((rec.name, rec.sha256),)),
    )
    return Identification(model)
