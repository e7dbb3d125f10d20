"""Measure how well a model predicts a recording that it has not seen, and describe the residual.

A recording may begin at any time in the life of a stage, and the sensor may have been zeroed since:
of the possible histories (de-energised, come from above, come from below) the one that fits best is
used, and the mean of the residual is reported separately as the offset.
"""

from dataclasses import dataclass

import numpy as np

from dehyst.models.cascade.history import replay
from dehyst.models.cascade.simulate import channels_of
from dehyst.models.errors import BadInput
from dehyst.models.identify.data.rows import check_scale
from dehyst.models.identify.uncertainty import estimate_noise
from dehyst.models.model import Model
from dehyst.models.recording import Bools, Floats, Recording
from dehyst.models.signals.error_size import Z95
from dehyst.models.signals.pace import measure_pace
from dehyst.models.signals.repeats import find_repeats
from dehyst.models.signals.rounding import quantum
from dehyst.models.units import spell_unit

LAGS = 40  # rows: longest lag of the residual's correlation with itself and the drive
FEWEST = 12  # rows by which an error and its noise can be judged
STILL = 1e-6  # share of the model's drive range up to which a drive does not move
COVERED, ENOUGH = 0.9, 0.5  # share of the range covered before rows count; of rows left
CLAIM = 1.5  # times the error that the model states: a larger error is worse than claimed
NARROW, WIDE = 0.85, 0.99  # allowed share of the rows within a 95 % interval
SLOWER = 1.5  # times the slowest pace of the recordings: no error is stated for slower drives
LEAST_STATED = 0.2  # smallest share of the rows by which an interval is judged
LATE, RARE = 1.2, 0.05  # periods: a longer step ends at a late sample; share of rows up to which
# late samples are exceptions
DOUBT = 5.0  # times the noise over the root of the rows: three standard errors of its estimate, by
# the median of second differences of white noise (1.65 / root of the rows each)
MOST_ROWS = 100_000  # rows of which the share of the motion in an error is found


@dataclass(frozen=True)
class Validation:
    """Figures of a validation.

    name: of the recording; rms: of measured minus model, without its mean; offset: that mean; span:
    of the displacement; noise: rms from row to row, NaN if too few neighbouring rows have a
    reading; claim: the error that the model states; start: the history that fits; predicted: (N,);
    autocorrelation: (LAGS,) of the residual, from a lag of one row; with_drive: (LAGS + 1,)
    correlation of the residual with the drive that many rows before; chance: size of such a
    correlation by chance; outside: share of the rows beyond the validity; unstated: share of the
    rows for which the 95 % interval does not apply, because they are outside or slower than any
    recorded drive; within: share of the other rows, without the offset, that the model's 95 % band
    and the noise explain, None if they are too few or the noise is not known; late: number of rows
    at late samples, which are not judged; noisier: rms of the recording's noise beyond that in the
    claim, which is no error of the model; coarse: the reading is rounded to steps wider than the
    band, so that no row shows whether the band is too wide; repeats: number of rows that repeat the
    reading of the row before, and stuck: at which the gauge is stuck or at its limit, which are not
    judged; has_interval: whether the model states one; if not, unstated is 1.
    """

    name: str
    unit: str
    rms: float
    offset: float
    span: float
    noise: float
    claim: float | None
    start: str
    predicted: Floats
    autocorrelation: Floats
    with_drive: Floats
    chance: float
    outside: float
    unstated: float
    within: float | None
    late: int
    noisier: float = 0.0
    coarse: bool = False
    repeats: int = 0
    stuck: int = 0
    has_interval: bool = True

    @property
    def share(self) -> float:
        """The error over the span; NaN if the reading is constant."""
        return self.rms / self.span if self.span else float("nan")

    @property
    def worse(self) -> bool:
        """Whether the error, but for the noise of a noisier gauge, is larger than the model claims;
        False if it claims nothing."""
        return self.claim is not None and not self.rms <= np.hypot(CLAIM * self.claim, self.noisier)

    @property
    def interval_is(self) -> str:
        """What is wrong with the width of the 95 % interval: "too narrow", "too wide", or ""."""
        if self.within is None or NARROW <= self.within <= WIDE:
            return ""
        if self.within < NARROW:
            return "too narrow"
        return "" if self.coarse else "too wide"

    @property
    def white(self) -> bool:
        """Whether the residual is white noise: within chance at nine lags in ten."""
        return float(np.mean(np.abs(self.autocorrelation) > self.chance)) <= 0.1

    @property
    def tied_to_drive(self) -> float:
        """Largest correlation of the residual with the drive."""
        return float(np.max(np.abs(self.with_drive)))


def validate(model: Model, recording: Recording) -> Validation:
    """Run the model on the recording's drive. Raises BadInput if units differ, columns are missing
    or too few rows are complete, and BadRecording if a column's size cannot be a stage's."""
    if recording.displacement is None:
        raise BadInput(f"{recording.name}: no displacement column; validation needs one")
    for what, ours, theirs in (
        ("drive", recording.drive_unit, model.drive_unit),
        ("displacement", recording.displacement_unit, model.displacement_unit),
    ):
        if ours != theirs:
            raise BadInput(
                f"{recording.name}: the {what} is in {ours}, the model's in {theirs}: a model "
                f"identified from recordings in {ours} is needed"
            )
    check_scale(recording)
    known = ~recording.missing_drive
    channels = {}
    for name in channels_of(model):
        if name not in recording.channels:
            raise BadInput(f"{recording.name}: the model reads the channel {name}, which is absent")
        known &= ~np.isnan(recording.channels[name])
    if int(np.count_nonzero(known & ~recording.missing_displacement)) < 2 * LAGS:
        raise BadInput(f"{recording.name}: too few rows have all that the model reads")
    at: slice | Bools = slice(None) if known.all() else known  # avoid copying a long recording
    channels = {name: recording.channels[name][at] for name in channels_of(model)}
    u, t, y = recording.drive[at], recording.t_s[at], recording.displacement[at]
    if float(np.ptp(u)) <= STILL * (model.validity.drive_max - model.validity.drive_min):
        raise BadInput(
            f"{recording.name}: the drive stays at {u[0]:.6g} {spell_unit(recording.drive_unit)} "
            "throughout, which shows nothing of a model; record a drive that moves"
        )
    again, stuck = find_repeats(y, u)
    y = np.where(again | stuck, np.nan, y)
    late = _find_late(t)
    read = ~np.isnan(y)
    judged_at = _find_settled(u, read) & ~late
    if np.count_nonzero(judged_at & read) < FEWEST:  # a gauge that was read only at late samples
        judged_at, late = read, np.zeros(u.size, dtype=bool)
    start, predicted = replay(model, t, u, channels, y)
    out = np.full(recording.size, np.nan)
    out[known] = predicted
    error = np.where(judged_at, y - predicted, np.nan)
    offset = float(np.nanmean(error))
    own, drive = _correlate(error - offset, u)
    fit = model.fit
    step = quantum(y[read])
    noise, within = estimate_noise(_without_motion(error, predicted), step), None
    outside = _find_outside(model, u, t)
    stated = ~(outside | _find_slower(model, u, t)) & ~np.isnan(error)
    share = float(np.count_nonzero(stated)) / float(np.count_nonzero(~np.isnan(error)))
    share = 0.0 if fit.band is None else share
    if fit.band is not None and share >= LEAST_STATED and np.isfinite(noise):
        reach = np.hypot(fit.band, Z95 * noise)
        judged = error[stated]
        within = float(np.mean(np.abs(judged - judged.mean()) <= reach))
    claim = fit.claim
    return Validation(
        name=recording.name,
        unit=model.displacement_unit,
        rms=float(np.nanstd(error)),
        offset=offset,
        span=float(np.nanmax(y) - np.nanmin(y)),
        noise=noise,
        claim=claim,
        start=start,
        predicted=out,
        autocorrelation=own,
        with_drive=drive,
        chance=Z95 / max(1.0, float(np.count_nonzero(~np.isnan(error)))) ** 0.5,
        outside=float(np.mean(outside)),
        unstated=1.0 - share,
        has_interval=fit.band is not None,
        within=within,
        late=int(np.count_nonzero(late)),
        noisier=_find_noisier(error, noise, fit.noise_rms if fit.noise_rms is not None else claim),
        coarse=fit.band is not None and step > 2.0 * fit.band,  # its full width
        repeats=int(np.count_nonzero(again)),
        stuck=int(np.count_nonzero(stuck)),
    )


def _without_motion(error: Floats, predicted: Floats) -> Floats:
    """Return the error (N,) without what the predicted motion explains of it, at the row and its
    neighbours: a wrong gain is no noise, however few rows there are to a cycle."""
    moved = [np.roll(predicted, k) for k in (-1, 0, 1)]
    at = np.flatnonzero(np.isfinite(error + sum(moved)))
    if at.size < 2 * LAGS:
        return error
    some = at[:: max(1, at.size // MOST_ROWS)]
    columns = np.stack([*(x[some] for x in moved), np.ones(some.size)], axis=1)
    *shares, mean = np.linalg.lstsq(columns, error[some], rcond=None)[0]
    return error - mean - sum(k * x for k, x in zip(shares, moved, strict=True))


def _find_noisier(error: Floats, noise: float, claimed: float | None) -> float:
    """Return the rms of the noise that an error (N,) may contain beyond that in the claim; 0 if the
    recording does not show its noise."""
    doubt = DOUBT / max(1.0, float(np.count_nonzero(~np.isnan(error)))) ** 0.5
    power = (noise * (1.0 + doubt)) ** 2 - (claimed or 0.0) ** 2
    return float(np.sqrt(power)) if noise > (claimed or 0.0) and power > 0.0 else 0.0


def _find_settled(u: Floats, read: Bools) -> Bools:
    """Return the rows (N,) after the drive has covered nearly all of its range, or all rows if that
    comes late for the rows with a reading: earlier rows depend on the history of the stage."""
    covered = np.maximum.accumulate(u)
    covered -= np.minimum.accumulate(u)
    out = np.asarray(covered >= COVERED * covered[-1])
    enough = np.count_nonzero(out & read) >= ENOUGH * np.count_nonzero(read)
    return out if enough else np.ones(u.size, dtype=bool)


def _find_late(t: Floats) -> Bools:
    """Return the rows (N,) at a late sample and the row after it: the drive was held for longer
    than the grid says, and a slow gauge was read at another time. None if late samples are
    frequent."""
    steps = np.diff(t, prepend=np.nan)
    late = steps > LATE * np.nanmedian(steps)
    late[1:] |= late[:-1].copy()
    return late if np.mean(late) <= RARE else np.zeros(t.size, dtype=bool)


def _correlate(error: Floats, u: Floats) -> tuple[Floats, Floats]:
    """Return the autocorrelation (LAGS,) of the error, and its correlation (LAGS + 1,) with earlier
    drive; pairs with a missing value contribute nothing."""
    e = np.nan_to_num(error)
    v = u - u.mean()
    size, drive = float(e @ e) or 1.0, float(np.sqrt((e @ e) * (v @ v))) or 1.0
    own = [float(e[k:] @ e[: e.size - k]) / size for k in range(1, LAGS + 1)]
    with_drive = [float(e[k:] @ v[: v.size - k]) / drive for k in range(LAGS + 1)]
    return np.array(own), np.array(with_drive)


def _find_slower(model: Model, u: Floats, t: Floats) -> Bools:
    """Return the rows (N,) at which the drive is slower than in any recording of the model."""
    v = model.validity
    if v.slowest_s is None:
        return np.zeros(u.size, dtype=bool)
    pace = measure_pace(t, u, v.drive_max - v.drive_min)
    return np.asarray(pace > SLOWER * v.slowest_s)


def _find_outside(model: Model, u: Floats, t: Floats) -> Bools:
    """Return the rows (N,) beyond the drive range or the rate in which the model was identified."""
    v = model.validity
    margin = 1e-6 * (v.drive_max - v.drive_min)  # rounding in files
    beyond = (u < v.drive_min - margin) | (u > v.drive_max + margin)
    if v.rate_max and u.size > 1:
        beyond[1:] |= np.abs(np.diff(u)) / np.diff(t) > v.rate_max * (1.0 + 1e-6)
    return np.asarray(beyond)
