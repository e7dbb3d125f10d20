"""Check whether recordings make sense as drive and displacement of one stage, and refuse others in
one sentence with the remedy."""

from collections.abc import Sequence

import numpy as np

from dehyst.models.errors import BadInput, BadRecording, OddRecording
from dehyst.models.identify.data.outliers import SAMPLED, sample, thin
from dehyst.models.identify.data.rows import Rows
from dehyst.models.identify.setup import FitSetup
from dehyst.models.identify.tuning import TUNING
from dehyst.models.recording import Bools, Floats, Recording
from dehyst.models.signals.error_size import rms

ROUGHNESS_ROWS = 100_000  # used to measure the roughness: enough for a median
PLACES, FEW_PLACES = 100, 3
"""Number of equal parts of the drive's range; number of parts at which a drive that rests in no
others shows no loop."""


def require_same_units(recordings: Sequence[Recording]) -> None:
    """Raise BadInput if a recording is in other units than the first."""
    first = recordings[0]
    for other in recordings[1:]:
        if (other.drive_unit, other.displacement_unit) != (
            first.drive_unit,
            first.displacement_unit,
        ):
            raise BadInput(
                f"{other.name} is in {other.drive_column}, {other.displacement_column} and "
                f"{first.name} in {first.drive_column}, {first.displacement_column}; "
                "one model needs one pair of units"
            )


def require_different(recordings: Sequence[Recording]) -> None:
    """Raise BadInput if a recording is given twice."""
    seen: dict[str, str] = {}
    for one in recordings:
        if one.sha256 and one.sha256 in seen:
            raise BadInput(f"{one.name} has the same content as {seen[one.sha256]}; give it once")
        seen[one.sha256] = one.name


def require_drive_first(rows: Sequence[Rows]) -> None:
    """Raise BadRecording if the displacement column runs ahead of the drive column and is not
    plainly the measured one. A stage lags behind its drive, so the loop has one sense, except for
    stages (or sensors) whose springs lead. A reading contains the noise of its sensor; a commanded
    drive has none."""
    for one in rows:
        known = ~np.isnan(one.u) & ~np.isnan(one.y)
        if measure_line(one.u[known], one.y[known]) > 0.5 * float(np.std(one.y[known])):
            continue  # neither follows the other
        area = _measure_loop(one.u, one.y)
        noisier = _measure_roughness(one.y) > TUNING.far * _measure_roughness(one.u)
        if area < -TUNING.crumb and not noisier:
            raise BadRecording(
                f"{one.name}: the drive lags the displacement (loop area {-area:.1%} of its "
                "bounding box): are the columns swapped? the drive is u_..., the measured "
                "displacement y_..."
            )


def require_places(rows: Sequence[Rows], unit: str) -> None:
    """Raise BadRecording if the drives only jump between a few values: what the stage does between
    them is not shown."""
    u = np.concatenate([one.u[~np.isnan(one.u) & ~np.isnan(one.y)] for one in rows])
    low, span = float(u.min()), float(np.ptp(u))
    if not span:
        return
    rests = np.bincount(np.minimum((PLACES * (u - low) / span).astype(int), PLACES - 1))
    commonest = np.sort(np.argsort(rests)[-FEW_PLACES:])
    elsewhere = u.size - int(rests[commonest].sum())
    if elsewhere >= min(TUNING.fewest_rows, TUNING.half * u.size):
        return
    values = [f"{low + span * k / (PLACES - 1):.3g}" for k in commonest if rests[k]]
    raise BadRecording(
        f"{rows[0].name}: the drive only jumps between {len(values)} values ({', '.join(values)} "
        f"{unit}), which shows nothing of the loop between them; record a drive that moves through "
        "its range, such as a triangle, or that rests at many places (dehyst excite designs one)"
    )


def require_one_sense(rows: Sequence[Rows], unit: str) -> None:
    """Raise BadRecording if the displacement rises with the drive in some recordings and falls in
    others. unit: of displacement over drive."""
    slopes = []
    for one in rows:
        known = ~np.isnan(one.u) & ~np.isnan(one.y)
        u, y = one.u[known], one.y[known]
        # a line that leaves half of the rms explains three quarters of the power
        follows = bool(known.any()) and measure_line(u, y) < 0.5 * float(np.std(y))
        slopes.append(_fit_slope(u, y) if follows else np.nan)
    falls = np.array(slopes) < 0.0
    rises = np.array(slopes) > 0.0
    if not (falls.any() and rises.any()):
        return
    fewer = falls if falls.sum() <= rises.sum() else rises
    odd = ", ".join(one.name for one, is_odd in zip(rows, fewer, strict=True) if is_odd)
    figures = ", ".join(f"{r.name} {k:.3g} {unit}" for r, k in zip(rows, slopes, strict=True))
    raise BadRecording(
        f"{odd} does not match the others, its slope has the opposite sign: {figures}; reverse the "
        "sign of its sensor, or identify each stage separately"
    )


def _measure_loop(u: Floats, y: Floats) -> float:
    """Return the area that (u, y) encloses, per length of the drive's travel over its range and
    back and per range of y; positive if y lags behind u. Both directions of y count alike."""
    at = np.flatnonzero(~np.isnan(u) & ~np.isnan(y))
    if at.size < 10:  # rows: too few to show a loop
        return 0.0
    v, x = u[at], y[at]
    low, high = np.quantile(sample(x), [0.01, 0.99])  # without outliers
    x = np.clip(x, low, high)
    travel = float(np.sum(np.abs(np.diff(v))))
    slope = float(np.cov(sample(v), sample(x))[0, 1]) if at.size <= SAMPLED else 1.0
    area = float(np.sum(0.5 * (v[1:] + v[:-1]) * np.diff(x)))
    area -= 0.5 * float((v[-1] + v[0]) * (x[-1] - x[0]))  # close the loop by a straight line
    loops = travel / (2.0 * float(np.ptp(v)))
    return np.sign(slope) * area / (max(loops, 1.0) * float(np.ptp(v)) * max(high - low, 1e-300))


def _measure_roughness(x: Floats) -> float:
    """Return the rms of white noise that would change this much from row to row, over the range of
    x; from fourth differences, which leave little of a smooth signal."""
    known = x[~np.isnan(x)][:ROUGHNESS_ROWS]
    if known.size < 10 or not np.ptp(known):  # too few for a median
        return 0.0
    fourth = np.abs(np.diff(known, 4))
    return float(np.median(fourth) / (0.6745 * np.sqrt(70.0) * np.ptp(known)))


def require_better_than_a_line(
    setup: FitSetup, residuals: Sequence[Floats], picks: Sequence[Bools]
) -> None:
    """Raise BadRecording if the last fit leaves more than a straight line does, or is not a number;
    of several recordings, it names the one that does not belong to the others."""
    for one, error, pick in zip(setup.rows, residuals, picks, strict=True):
        if not pick.any():
            raise BadRecording(
                f"{one.name}: none of its rows can be used (the drive has only steps, or readings "
                "are missing); record a drive that moves continuously (dehyst excite designs one)"
            )
        (some,) = thin([pick], TUNING.rows_fitted)
        own = float(np.nanmax(one.u) - np.nanmin(one.u))
        if int(some.sum()) < TUNING.fewest_rows or np.ptp(one.u[some]) < TUNING.half * own:
            continue  # a rest, where a straight line fits as well
        line = measure_line(one.u[some], one.y[some])
        left = rms(error[some])
        if not left <= line:
            belongs = (
                "the recordings are of different stages"
                if len(setup.rows) > 1
                else ("too little of the loop was recorded")
            )
            raise BadRecording(
                f"{one.name}: the best model leaves {left:.4g} and a straight line {line:.4g} rms; "
                f"{belongs}; record a drive that runs through its range and back several times "
                "(dehyst excite designs one), of one stage"
            )


def require_following(setup: FitSetup, held_rms: float) -> None:
    """Raise BadRecording if the displacement depends little on the drive. held_rms: held-out rms
    error of the best model."""
    some = thin(setup.picks, TUNING.rows_fitted)
    y = np.concatenate([one.y[p] for one, p in zip(setup.rows, some, strict=True)])
    explained = 1.0 - held_rms**2 / max(float(np.var(y)), 1e-300)
    if explained < TUNING.half:
        raise BadRecording(
            f"{setup.rows[0].name}: the displacement does not follow the drive (a model explains "
            f"{max(0.0, explained):.0%} of it); check the sensor, its cable and the columns"
        )


def require_one_stage(
    names: Sequence[str],
    together: Sequence[float],
    alone: Sequence[float],
    sizes: Sequence[float],
    unit: str,
) -> str:
    """Raise BadRecording if recordings are predicted well by their own models and badly by a common
    one; if a little worse by the common one, return a remark, else "".

    together, alone: (G,) rms residuals of each recording with the common model and with its own;
    sizes: (G,) standard deviations of their displacements.
    """
    lower_median = float(np.sort(alone)[(len(alone) - 1) // 2])
    usual = max(lower_median, 1e-300)  # what a model of this class leaves of the stage
    ratio = np.array(together) / np.maximum(alone, usual)
    apart = np.array(together) / np.maximum(sizes, 1e-300)
    ratio = np.where(apart > TUNING.crumb, ratio, 1.0)
    if len(names) < 2 or float(np.max(ratio)) <= TUNING.twice:
        return ""
    figures = ", ".join(
        f"{name} {a:.3g} {unit} (alone {b:.3g})"
        for name, a, b in zip(names, together, alone, strict=True)
    )
    stays = np.array(alone) / np.maximum(sizes, 1e-300)  # 1: it does not follow its own drive
    silent = float(stays.min()) < TUNING.half <= float(stays.max())
    odd = names[int(np.argmax(stays if silent else ratio))]
    if float(np.max(ratio)) <= TUNING.far or float(np.max(apart)) <= TUNING.small:
        return (
            f"{odd} differs from the others: one model for all leaves {figures} rms; "
            "were stage, load and unit the same?"
        )
    raise OddRecording(
        f"{odd} does not match the others: one model for all leaves {figures} rms; identify the "
        "recordings of each stage, load and unit separately",
        odd,
    )


def measure_line(u: Floats, y: Floats) -> float:
    """Return the rms residual of a straight line through (u, y)."""
    return rms(y - y.mean() - _fit_slope(u, y) * (u - u.mean()))


def _fit_slope(u: Floats, y: Floats) -> float:
    """Return the slope of the straight line through (u, y)."""
    du = u - u.mean()
    power = float(du @ du)
    return float(du @ (y - y.mean())) / power if power > 0.0 else 0.0
