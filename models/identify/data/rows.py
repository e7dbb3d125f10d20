"""Prepare a recording for identification: which rows can be used as equations, and why others
cannot.

Nothing is filled in. A missing drive sample leaves the operators unchanged; a missing displacement,
or a rate across a gap, costs that one equation; after a long gap the memory of the stage is unknown
again.
"""

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np
from numba import njit
from numpy.typing import NDArray

from dehyst.models.errors import BadRecording
from dehyst.models.identify.data.outliers import remove_glitches, sample
from dehyst.models.identify.tuning import TUNING
from dehyst.models.recording import GAP_PERIODS, Bools, Floats, Recording
from dehyst.models.signals.repeats import find_repeats
from dehyst.models.units import spell_unit

REGULAR = 1e-3
"""Deviation of the time steps, as a share of the usual one, below which stamps do not jitter."""
REPEATED = (
    "{} of {} rows repeat the previous reading: the gauge was polled faster than it updates; each "
    "reading counts once"
)
FROZEN = (
    "{} of {} readings stay exactly the same while the drive moves: the gauge is stuck or at its "
    "limit there; they were left out"
)
SMALLEST, LARGEST = 1e-9, 1e10
"""Range of a drive or a displacement, in its unit, between which it can be a stage's: a thousandth
of what the finest gauges show (1 pm, 1 nrad), and more than a counter of 32 bits counts. Beyond it
the unit is wrong, and the fit would lose its digits."""
ONE_WAY, RETURNS = 0.2, 0.7
"""Shares of the drive's range: a recording that returns over less of it shows no loop, and one that
returns over less than the second shows only a part of it, which is said."""
SWEPT = 0.9
"""Share of a recording's drive range that the drive has to sweep before its memory is known."""


@dataclass
class Rows:
    """The equations of one recording.

    u, rate, y: (N,) drive, du/dt over the true time step, displacement; NaN where unknown. use:
    (N,) rows that can be used as equations. resets: rows where the memory of the stage is unknown.
    settled: (N,) rows at which no operator that still moves depends on the unknown start; one that
    is too wide to move adds a constant. virgin:
    the start looks de-energised. notes: remarks for the user. piece: (N,) stretch of the drive.
    came_from: where the drive had been before a reset, relative to the operators' offset.
    """

    name: str
    t_s: Floats
    u: Floats
    rate: Floats
    y: Floats
    use: Bools
    resets: NDArray[np.intp]
    settled: Bools
    virgin: bool
    period_s: float
    notes: list[str] = field(default_factory=list)
    piece: NDArray[np.int8] = field(default_factory=lambda: np.zeros(0, dtype=np.int8))
    came_from: float = 0.0

    def __post_init__(self) -> None:
        if self.piece.size != self.u.size:  # until stretches are distinguished
            self.piece = np.zeros(self.u.size, dtype=np.int8)


def read_rows(recording: Recording) -> Rows:
    """Return the rows of one recording.

    Raises BadRecording when nothing can be learned from it, in one sentence with the remedy.
    """
    name = recording.name
    if recording.displacement is None:
        raise BadRecording(f"{name}: no displacement column (y_um, ...); identification needs one")
    _require_size(name, recording.size)
    notes = [text] if (text := recording.defects()) else []
    u, y, t = recording.drive, recording.displacement, recording.t_s
    for out, says in zip(find_repeats(y, u), (REPEATED, FROZEN), strict=True):
        if out.any():
            y = np.where(out, np.nan, y)
            notes.append(f"{name}: {says.format(np.count_nonzero(out), y.size)}")
    u = remove_glitches(name, t, u, notes)
    present = ~np.isnan(u)
    for column, values in ((recording.drive_column, u), (recording.displacement_column, y)):
        if np.isnan(values).all():
            raise BadRecording(f"{name}: {column} holds no numbers, only missing values")
    _require_size(name, int(np.count_nonzero(present & ~np.isnan(y))))
    _require_motion(recording, u, y, notes)
    own = float(np.nanmax(u) - np.nanmin(u))
    period = recording.period_s
    if _stamps_jitter(t, u):
        period = float(t[-1] - t[0]) / (t.size - 1)
        t = _regularise(t, period)
        notes.append(
            f"{name}: the time stamps jitter, but the sampling does not; it is treated as uniform"
        )
    rate, resets = compute_rates(t, u, period)
    settled = np.zeros(u.size, dtype=bool)
    _settle(u, resets, SWEPT * own, settled)
    use = present & ~np.isnan(y) & ~np.isnan(rate)
    virgin = _looks_virgin(u[present], own)
    return Rows(name, t, u, rate, y, use, resets, settled, virgin, period, notes)


def _require_size(name: str, size: int) -> None:
    if size < TUNING.fewest_rows:
        raise BadRecording(
            f"{name}: {size} usable rows; identification needs at least {TUNING.fewest_rows}, "
            "preferably several thousand"
        )


def _require_motion(recording: Recording, u: Floats, y: Floats, notes: list[str]) -> None:
    name, unit = recording.name, spell_unit(recording.drive_unit)
    low, high = float(np.nanmin(u)), float(np.nanmax(u))
    check_scale(recording)
    if high - low <= 1e-9 * max(1.0, abs(high)):
        raise BadRecording(
            f"{name}: the drive stays at {low:.6g} {unit} throughout; nothing can be identified; "
            "drive the stage through its range (dehyst excite designs a drive)"
        )
    if np.nanmax(y) == np.nanmin(y):
        raise BadRecording(
            f"{name}: the displacement stays at {np.nanmin(y):.6g} {recording.displacement_unit} "
            "while the drive moves; check the sensor and its cable"
        )
    rise, fall = measure_travels(u[~np.isnan(u)])
    slow_rise, slow_fall = measure_travels(_without_jumps(recording.t_s, u, high - low))
    if min(slow_rise, slow_fall) < ONE_WAY * (high - low) < high - low < max(slow_rise, slow_fall):
        rise, fall = slow_rise, slow_fall  # a sawtooth, or ramps one after another
    if min(rise, fall) < ONE_WAY * (high - low):
        way = "up" if rise > fall else "down"
        raise BadRecording(
            f"{name}: the drive only goes {way}, but hysteresis shows only after a reversal; "
            "record at least one full loop (dehyst excite designs a drive)"
        )
    if min(rise, fall) < RETURNS * (high - low):
        notes.append(
            f"{name}: the drive returns over only {min(rise, fall) / (high - low):.0%} of its "
            "range; the rest of the loop is extrapolated"
        )


def check_scale(recording: Recording) -> None:
    """Raise BadRecording if the drive or the displacement moves, but by less or more than that of
    any stage. A few wild readings do not count."""
    for what, values, unit in (
        ("drive", recording.drive, spell_unit(recording.drive_unit)),
        ("displacement", recording.displacement, recording.displacement_unit),
    ):
        known = np.zeros(0) if values is None else values[np.isfinite(values)]
        low, high = np.quantile(known, (0.005, 0.995), method="nearest") if known.size else (0, 0)
        span = float(high) - float(low)
        if span > 0.0 and not SMALLEST <= span <= LARGEST:
            raise BadRecording(
                f"{recording.name}: the {what} moves over {span:.3g} {unit} in all, which is too "
                f"{'small' if span < SMALLEST else 'large'} for a stage: check the unit and the "
                "scale factor of this column"
            )


def _without_jumps(t: Floats, u: Floats, span: float) -> Floats:
    """Return the path (M,) of the drive without the moves that no row shows: of more than a tenth
    of its range from one row to the next, or in a gap."""
    known = ~np.isnan(u)
    steps, times = np.diff(u[known]), np.diff(t[known])
    seen = (np.abs(steps) < TUNING.minor * span) & (times <= TUNING.long_gap * np.median(times))
    return np.concatenate([[0.0], np.cumsum(np.where(seen, steps, 0.0))])


@njit(cache=True, nogil=True)
def measure_travels(u: Floats) -> tuple[float, float]:
    """Return the largest rise above an earlier value, and the largest fall below one."""
    low = high = u[0]
    rise = fall = 0.0
    for i in range(u.size):
        low, high = min(low, u[i]), max(high, u[i])
        rise, fall = max(rise, u[i] - low), max(fall, high - u[i])
    return rise, fall


@njit(cache=True, nogil=True)
def compute_rates(t: Floats, u: Floats, period: float) -> tuple[Floats, NDArray[np.intp]]:
    """Return the rate (N,) over each row's own step, NaN after a gap; and the rows after a long
    gap."""
    rate = np.full(u.size, np.nan)
    resets = np.empty(u.size, dtype=np.intp)
    count = 0
    last = -1
    for i in range(u.size):
        if np.isnan(u[i]):
            continue
        if last < 0:
            rate[i] = 0.0
            resets[count] = i
            count += 1
        else:
            dt = t[i] - t[last]
            if dt <= GAP_PERIODS * period:
                rate[i] = (u[i] - u[last]) / dt
            elif dt > TUNING.long_gap * period:
                resets[count] = i
                count += 1
        last = i
    return rate, resets[:count].copy()


def _stamps_jitter(t: Floats, u: Floats) -> bool:
    """Return whether the drive is a smoother function of the sample number than of its time stamp.

    Then the samples were regular and the stamps were late at random; rates by such stamps would be
    noise. Only if hardly any sample is missing.
    """
    t, u = t[:200_000], u[:200_000]
    steps = np.diff(t)
    usual = float(np.median(steps))
    off = float(np.quantile(np.abs(steps - usual), 0.9))
    if float(np.max(steps)) > 3.0 * usual or off < REGULAR * usual:
        return False
    part = (t[1:-1] - t[:-2]) / (t[2:] - t[:-2])
    by_number = np.abs(u[1:-1] - 0.5 * (u[:-2] + u[2:]))
    by_stamp = np.abs(u[1:-1] - u[:-2] - part * (u[2:] - u[:-2]))
    known = ~np.isnan(by_number)
    return bool(np.median(by_number[known]) < TUNING.most * np.median(by_stamp[known]))


@njit(cache=True, nogil=True)
def _regularise(t: Floats, period: float) -> Floats:
    """Return regular times whose numbering follows jittering stamps: every step is a multiple of
    the period."""
    out = np.empty(t.size)
    out[0] = expected = t[0]
    number = 0.0
    for i in range(1, t.size):
        steps = max(1.0, np.round((t[i] - expected) / period))
        expected += steps * period
        expected += 0.01 * (t[i] - expected)  # follows a clock that drifts
        number += steps
        out[i] = t[0] + number * period
    return out


@njit(cache=True, nogil=True)
def _settle(u: Floats, resets: NDArray[np.intp], travel: float, settled: Bools) -> None:
    """Mark rows whose drive has covered `travel` since the memory was last unknown."""
    low, high, next_reset = np.inf, -np.inf, 0
    for i in range(u.size):
        if next_reset < resets.size and resets[next_reset] == i:
            low, high = np.inf, -np.inf
            next_reset += 1
        if not np.isnan(u[i]):
            low, high = min(low, u[i]), max(high, u[i])
        settled[i] = high - low >= travel


def _looks_virgin(u: Floats, span: float) -> bool:
    """Return whether the drive starts at zero, and there at rest or at the end of its range."""
    if abs(u[0]) > TUNING.crumb * span:
        return False
    at_end = min(u[0] - float(u.min()), float(u.max()) - u[0]) <= TUNING.crumb * span
    steps = np.abs(np.diff(u[:20000]))
    at_rest = float(steps[:3].max()) <= 0.1 * float(np.quantile(steps, 0.99))
    return at_end or at_rest


def find_drive_range(rows: Sequence[Rows]) -> tuple[float, float]:
    """Return the lowest and highest drive of several recordings."""
    return min(float(np.nanmin(r.u)) for r in rows), max(float(np.nanmax(r.u)) for r in rows)


def find_measured_range(rows: Sequence[Rows]) -> tuple[float, float]:
    """Return the same of the rows that have a reading, where a larger part of the range has
    none."""
    low, high = find_drive_range(rows)
    measured = [one.u[~np.isnan(one.u) & ~np.isnan(one.y)] for one in rows]
    first, last = min(float(u.min()) for u in measured), max(float(u.max()) for u in measured)
    least = TUNING.small * (high - low)
    return first if first - low > least else low, last if high - last > least else high


def find_rate_range(rows: Sequence[Rows]) -> float:
    """Return the largest rate that occurs more than occasionally in the recordings [drive unit /
    s]."""
    rates = np.concatenate([np.abs(sample(r.rate[r.use])) for r in rows])
    moving = rates[rates > 0]
    return float(min(moving.max(), 1.5 * np.quantile(moving, 0.99))) if moving.size else 0.0


def find_acceleration(rows: Sequence[Rows], rate_max: float) -> float:
    """Return the largest change of the rate from sample to sample [drive unit / s^2], ignoring
    jumps faster than rate_max. It is large for a drive with corners or one that is read with noise.
    """
    largest = 0.0
    for one in rows:
        with np.errstate(invalid="ignore"):
            rate = np.where(np.abs(one.rate) <= rate_max * (1.0 + 1e-9), one.rate, np.nan)
        change = np.abs(np.diff(rate))
        if not np.isnan(change).all():
            largest = max(largest, float(np.nanmax(change)) / one.period_s)
    return largest
