"""Warnings about the recordings that come before any statement about the stage."""

from collections.abc import Sequence

import numpy as np

from dehyst.models.diagnosis.data.drive_path import (
    count_turns,
    has_few_turns,
    has_long_rest,
    has_rests,
)
from dehyst.models.diagnosis.data.noise import quantum
from dehyst.models.diagnosis.result import DataQuality
from dehyst.models.physics.candidate import format_length
from dehyst.models.signals.drive_segments import BUTTERFLY, count_reversing_segments
from dehyst.models.signals.following import follows_changes
from dehyst.models.signals.joined import Data, Floats
from dehyst.models.units import how_many

COARSE = 1.5  # times the noise rms: a larger step of the reading is reported
FOLLOWS = 0.2  # share of the displacement's power that a memory of the drive must explain
BUTTERFLY_WARNING = (
    f"{BUTTERFLY}: no monotone model fits, and no other can be inverted; keep the drive on one "
    "side of the turning points"
)
FEW_PLACES = (
    "the drive is periodic and sampled at only a few points of its cycle, where hysteresis alone "
    "could explain every reading: a delay, a lag or a slew limit cannot be found here; sample "
    "faster, or at a rate that is not a multiple of the drive's frequency"
)
ONE_SIDE = "Keep the drive on one side of the turning points, and diagnose again."
CURVE = 7  # degree of the function of the drive that a stage without hysteresis follows
NARROW = (0.1, 1e-3)  # of the noise, of the reading's range: largest residual above the noise
TOO_NOISY = 0.02  # of the reading's range: with more noise a loop may hide
WIDTH = 3.0  # full width of a loop over the rms that a curve through its middle leaves
SLOW = 0.2  # rms step of the drive between samples over its std: above, the sampling is slow


def survey(
    data: Data, fitted: Data, noise: tuple[float, float], unexplained: float, more: Sequence[str]
) -> DataQuality:
    """Return the quality of the recordings. data: all samples; fitted: those that were fitted;
    noise: white and whole rms; unexplained: mean square that a memory of the drive of any shape
    leaves; more: further warnings, those about the model in use first."""
    said = list(more)
    sigma, whole = noise
    if data.missing:
        share = data.missing / max(data.n, 1)
        said.append(
            f"{how_many(data.missing, 'reading is', 'readings are')} missing ({share:.1%}); "
            "nothing was filled in"
        )
    if data.repeats:
        said.append(
            f"{how_many(data.repeats, 'sample repeats', 'samples repeat')} the previous reading, "
            "because the gauge was polled faster than it updates; each reading counts once"
        )
    if data.frozen:
        said.append(
            f"{how_many(data.frozen, 'reading stays', 'readings stay')} exactly the same while the "
            "drive moves: the gauge is stuck or at its limit there; left out"
        )
    if data.lone:
        readings = how_many(data.lone, "isolated reading is", "isolated readings are")
        said.append(f"{readings} far from both neighbours, though the drive is not; left out")
    if data.stalls:
        said.append(
            f"the recorder stopped {how_many(data.stalls, 'time')}; the samples "
            "after each stop were left out, because the drive in between is not known"
        )
    step = quantum(data.y)
    if step > COARSE * sigma:
        said.append(
            f"the reading is quantised in steps of {format_length((step, data.unit))}, coarser "
            "than its noise: smaller effects cannot be detected"
        )
    if whole > 1.2 * sigma:  # 44 % more power than the white part alone
        said.append(
            f"the noise is coloured: {format_length((whole, data.unit))} rms in all, of which "
            f"{format_length((sigma, data.unit))} from sample to sample"
        )
    turns = count_turns(data)
    is_other_class = turns == 0 or BUTTERFLY_WARNING in more
    if not (is_other_class or has_response_to_drive(data, unexplained)):
        share = max(0.0, 1.0 - unexplained / _variance(data))
        why = (
            f"hysteresis of any shape explains only {share:.0%} of it"
            if share <= FOLLOWS
            else "its changes do not match those of the drive"
        )
        said.append(
            f"the displacement does not follow the drive: {why}; check the sensor, its cable and "
            "the columns, and whether the recording was made under feedback"
        )
    if turns and has_no_loop(data, sigma):
        reach = float(np.ptp(data.y[data.rows]))
        width = WIDTH * max(NARROW[0] * sigma / reach, NARROW[1])
        said.append(
            "no hysteresis is visible: a single-valued curve explains the reading down to its "
            f"noise, and a loop {width:.1%} of the range wide would have been detected; is the "
            "stage in closed loop?"
        )
    if _is_slow(data):
        said.append(
            "the sampling is slow for this drive: effects that last only a sample or two cannot be "
            "distinguished from hysteresis"
        )
    if has_few_turns(data):
        slow = "" if has_long_rest(data) else ", and no slow change,"
        said.append(
            f"the drive {'hardly' if turns else 'never'} reverses: "
            + (
                "only effects that appear while it rests can be distinguished from hysteresis"
                if has_rests(data)
                else f"no effect that it causes{slow} can be distinguished from hysteresis"
            )
        )
    left_out = int(np.count_nonzero(data.heads))
    if left_out > 0:
        said.append(
            f"{how_many(left_out, 'sample was', 'samples were')} left out of the fits, because the "
            "stage's unknown earlier history acts there"
        )
    if fitted.n < data.n:
        said.append(
            f"{int(np.count_nonzero(fitted.rows))} of {data.n} samples were fitted, in stretches; "
            "the errors refer to all samples"
        )
    if fitted.rows_early:
        said.append(
            "each reading is recorded one row before the drive value that it belongs to; the "
            "diagnosis accounts for this, and a model that it writes leads by a sample as the "
            "recordings do: check the order in which the recorder reads and writes"
        )
    if fitted.early:
        said.append(
            "the reading leads the drive by half a sample, because each command is held, not "
            "ramped; the diagnosis accounts for this"
        )
    if fitted.stepped:
        said.append(
            "lags and modes lead by half a sample, because each command is held, not ramped; the "
            "diagnosis and the model that it writes account for this"
        )
    if len(data.names) == 1:
        said.append("only one recording: no other waveform was available as hold-out")
    rows = int(np.count_nonzero(data.raw_index >= 0))
    return DataQuality(rows, data.missing, data.stalls, tuple(said))


def has_response_to_drive(data: Data, unexplained: float) -> bool:
    """Return whether the drive explains part of the displacement, and part of its changes: a memory
    of any shape explains part of a wandering reading by chance."""
    if unexplained >= (1.0 - FOLLOWS) * _variance(data):
        return False
    parts = [data.rows & (data.part == p) for p in np.unique(data.part)]
    return any(follows_changes(data.u[k], data.y[k]) for k in parts)


def has_no_loop(data: Data, sigma: float) -> bool:
    """Return whether a function of the drive, and an offset for each recording, explain all but the
    noise."""
    k = np.flatnonzero(data.rows)
    k = k[:: max(1, k.size // 50_000)]  # rows, to save time: a curve of few terms needs no more
    u, y = data.u[k], data.y[k]
    reach = float(np.ptp(y)) if k.size else 0.0
    if sigma > TOO_NOISY * reach or not np.ptp(u):
        return False
    curve = np.polynomial.legendre.legvander(2.0 * (u - u.min()) / np.ptp(u) - 1.0, CURVE)
    own = (data.rec[k][:, None] == np.unique(data.rec[k])[1:]).astype(float)
    columns = np.hstack([curve, own])
    left = y - columns @ np.linalg.lstsq(columns, y, rcond=None)[0]
    above = float(np.mean(left**2)) - sigma**2
    return above < max(NARROW[0] * sigma, NARROW[1] * reach) ** 2


def _variance(data: Data) -> float:
    return max(float(np.var(data.y[data.rows])), 1e-300)


def has_reversals_within_sweeps(data: Data) -> bool:
    """Return whether the displacement reverses within sweeps of the drive, in most of them."""
    reach = float(np.ptp(data.y))
    parts = [data.part == p for p in np.unique(data.part)]
    counts = [count_reversing_segments(data.u[k], data.y[k], data.span, reach) for k in parts]
    ways, backs = (sum(column) for column in zip(*counts, strict=True))
    return ways > 0 and backs > 0.5 * ways


def _is_slow(data: Data) -> bool:
    """Return whether the drive often moves far between two samples."""
    step = np.diff(data.u)[~data.starts[1:]]
    return bool(np.sqrt(np.mean(step**2)) > SLOW * np.std(data.u))


def centred_residual(data: Data, prediction: Floats) -> Floats:
    """Return (N,) the reading less a prediction, without its mean over the rows of each
    recording."""
    e = data.y - prediction
    out = np.empty(data.n)
    for i in range(len(data.names)):
        k = data.rec == i
        out[k] = e[k] - float(np.mean(e[k & data.rows])) if np.any(k & data.rows) else e[k]
    return out
