"""Slow trim: correct the target slowly from the gauge, so that the mean position is right.

An integral correction w of the target compensates the difference between the reading and the
model's prediction of it, d = y - y_model:

    dw/dt = (-d - w) / T,        |w| <= limit,    |dw/dt| <= rate.

The model follows the drive that was really written, after range and slew limits, so d does not grow
while the output is at a limit: the anti-windup is part of the structure (internal model
control: Morari & Zafiriou, Robust Process Control, 1989, ch. 3). With a model of the right gain
this is plain integral control of the target's error with the time constant T: a constant d leaves
the error d exp(-t / T), by backward differences d (1 + h / T)^-n after n samples of h, and no
frequency is amplified. With a sensor lag or delay L that the model lacks, it is stable for
L / T < pi / 2 (`least_time_constant_s` keeps a margin).

Readings are checked before they are used (`FreezeReason`). A frozen trim keeps its value and
continues from it. A reading that has jumped is accepted again once its difference from the model
has been constant for a while, at rest or in motion, and is plausible: close to the model itself, or
to the usual difference. It may be off from either by less than a jump, which would have been
followed anyway, so a gauge that stays wrong moves nothing. Soon after the model's state was
initialised, a difference up to the limit is plausible: then the state is in doubt, not the gauge.
"""

import math
from typing import Any, NamedTuple

import numpy as np
from numba import njit
from numpy.typing import NDArray

from dehyst.models.learning.freeze_reason import FreezeReason
from dehyst.models.model import Model
from dehyst.models.physics import KINDS
from dehyst.models.physics.kind import Led, Shifted


class Tuning(NamedTuple):
    """Constants of the trim, set with `python -m tests.benchmarks.daemon.learning`: its rows on
    trim, staircase and faults."""

    time_constant_s: float = 0.3  # follows a step's creep to 5 nm, but not the gauge's noise
    limit: float = 0.1  # of the reach
    rate: float = 0.02  # of the reach, per second
    belief: float = 2.0  # limits: a reading further from the model is rejected
    jump: float = 0.25  # limits: how far the reading may move against the model within jump_s,
    jump_share: float = 0.15  # plus this part of the model's motion in that time
    jump_s: float = 0.02
    jump_samples: int = 4  # lower limit of jump_s, for slow loops
    jump_noises: float = 6.0
    back_s: float = 0.1  # a reading that is back for this long is accepted again
    settled_s: float = 2.0  # creep and sensor ringing are over, and a loose contact shows again
    settled: float = 0.5  # jumps: a difference that varies by less is settled
    usual_s: float = 300.0  # long: a drift that a gauge reverses within a minute has no effect
    young_s: float = 2.0  # of commanded motion: the model's state may lack earlier history
    new_s: float = 0.2  # a new model finds its state along the drive: no jump is detected
    stuck_noises: float = 10.0  # motion of the model while the reading does not change
    reported_s: float = 0.1  # a shorter state is not reported
    margin: float = 4.0  # least time constant, in lags of the sensor


TUNING = Tuning()


SETTING = np.dtype(
    [
        ("on", "<i8"),
        ("time_constant_s", "<f8"),
        ("limit", "<f8"),
        ("rate", "<f8"),  # per second
        ("period_s", "<f8"),
        ("jump", "<f8"),
        ("jump_s", "<f8"),
        ("belief", "<f8"),
        ("stuck", "<f8"),
        ("learned", "<f8"),  # largest learned correction that is accepted
    ]
)
STATE = np.dtype(
    [
        ("trim", "<f8"),  # in force, added to the target
        ("aim", "<f8"),  # the integral; the trim follows it at no more than the rate
        ("zero", "<f8"),  # added to the reading
        ("difference", "<f8"),  # reading minus model, averaged over jump_s; NaN: none accepted
        ("seen", "<f8"),  # the same over reported_s, accepted or not; NaN: no reading
        ("moved", "<f8"),  # motion of the model in the last jump_s
        ("predicted", "<f8"),  # newest prediction, NaN: none yet
        ("reading", "<f8"),  # newest reading that differed from the one before,
        ("predicted_then", "<f8"),  # the prediction,
        ("aim_then", "<f8"),  # and the integral at that time
        ("since_s", "<f8"),  # time since the newest valid reading
        ("new_s", "<f8"),  # how long readings have been compared with this model
        ("out_s", "<f8"),  # how long readings have been outside the jump limit
        ("in_s", "<f8"),  # how long they have been inside
        ("usual", "<f8"),  # difference over usual_s, of accepted readings; NaN: none
        ("anew", "<f8"),  # difference since the jump, and its duration; NaN: none yet
        ("anew_s", "<f8"),
        ("age_s", "<f8"),  # how long the stage was commanded with this model state,
        ("jumped_s", "<f8"),  # and age_s at which the reading jumped
        ("jumped", "<i8"),
        ("stuck", "<i8"),
        ("distrusted", "<i8"),
        ("why", "<i8"),  # FreezeReason of the newest sample
        ("lasting", "<i8"),  # the newest that has lasted for reported_s
        ("why_s", "<f8"),
    ]
)

NOTHING, OFF, NOT_RUNNING, NO_READING, STUCK, JUMPED, BEYOND, DISTRUSTED, SETTLING = map(
    int, FreezeReason
)


def make_trim_setting(
    period_s: float,
    reach: float,
    noise: float,
    on: bool,
    time_constant_s: float | None = None,
    limit: float | None = None,
    rate: float | None = None,
) -> NDArray[Any]:
    """Return (1,) SETTING. reach: range of displacements that the stage attains; noise: of a
    reading; None: derived from the reach, see Tuning. All in the displacement unit."""
    out = np.zeros(1, SETTING)
    most = TUNING.limit * reach if limit is None else limit
    out["on"], out["period_s"], out["limit"] = on, period_s, most
    out["time_constant_s"] = TUNING.time_constant_s if time_constant_s is None else time_constant_s
    out["rate"] = TUNING.rate * reach if rate is None else rate
    out["belief"] = TUNING.belief * max(most, TUNING.limit * reach)
    out["jump"] = max(TUNING.jump * TUNING.limit * reach, TUNING.jump_noises * noise)
    out["jump_s"] = max(TUNING.jump_s, TUNING.jump_samples * period_s)
    out["stuck"] = TUNING.stuck_noises * noise
    out["learned"] = TUNING.limit * reach
    return out


def begin_trim() -> NDArray[Any]:
    """Return (1,) STATE of a trim that has had no reading yet."""
    out = np.zeros(1, STATE)
    forget_trim(out[0])
    return out


def sensor_lag_s(model: Model, period_s: float) -> float:
    """Return the sum of lag and delay of the model's sensor blocks [s] in a loop with this period
    [s]."""
    total = 0.0
    for block in model.blocks:
        if block.place != "sensor":
            continue
        kind = KINDS[block.kind]
        values = kind.values(block, model.drive_unit, model.displacement_unit)
        p, _ = kind.numbers(values, period_s)
        match kind.inverse:
            case Led(lead):
                total += max(0.0, float(lead(p)[0]))
            case Shifted(seconds):
                total += float(seconds(p))
    return total


def least_time_constant_s(lag_s: float) -> float:
    """Return the shortest well-damped time constant [s] for a sensor's lag and delay [s]."""
    return TUNING.margin * lag_s


@njit(cache=True, nogil=True)
def forget_trim(s: Any) -> None:
    """Reset readings and correction, as for another model; keep the gauge's zero."""
    s.trim = s.aim = s.moved = s.since_s = s.new_s = s.out_s = s.in_s = s.why_s = 0.0
    s.difference = s.seen = s.predicted = s.reading = s.predicted_then = math.nan
    s.aim_then = s.age_s = s.jumped_s = s.anew_s = 0.0
    s.usual = s.anew = math.nan
    s.jumped = s.stuck = s.why = s.lasting = 0


@njit(cache=True, nogil=True)
def move_zero(s: Any, shift: float) -> None:
    """Shift the gauge's zero by `shift`; readings are accepted from now on."""
    s.zero += shift
    s.difference = s.seen = s.reading = s.predicted_then = math.nan
    s.usual = s.anew = math.nan
    s.jumped = s.stuck = 0
    s.out_s = s.in_s = s.anew_s = 0.0


@njit(cache=True, nogil=True)
def take(p: Any, s: Any, reading: float, predicted: float, held: bool, running: bool) -> bool:
    """Process one sample: check the reading, move the trim. Return True when `lasting` changed.

    p: SETTING, s: STATE; reading: includes the zero, NaN where invalid; predicted: the model's
    prediction of it; held: no new reading was due; running: the stage is commanded.
    """
    period = p.period_s
    s.since_s += period
    if held:
        _move(p, s, running and s.why == NOTHING)
        return False
    why = _judge(p, s, reading, predicted)
    dt = min(s.since_s, 0.25 * p.time_constant_s)
    if why != NO_READING:
        s.since_s = 0.0
    if running:
        s.age_s += period
    if p.on == 0:
        why = OFF
    elif s.distrusted != 0 and why == NOTHING:
        why = DISTRUSTED
    elif not running and why == NOTHING:
        why = NOT_RUNNING
    if why == NOTHING and s.out_s == 0.0:
        goal = min(max(predicted - reading, -p.limit), p.limit)
        s.aim += dt / (p.time_constant_s + dt) * (goal - s.aim)
    elif why == STUCK:
        s.aim = s.aim_then  # undo what the stuck reading has moved
    elif why != NOTHING:
        s.aim = s.trim
    _move(p, s, running and why in (NOTHING, STUCK))
    s.why_s = s.why_s + period if why == s.why else 0.0
    s.why = why
    if s.why_s >= TUNING.reported_s and s.lasting != why:
        s.lasting = why
        return True
    return False


@njit(cache=True, nogil=True)
def _move(p: Any, s: Any, moves: bool) -> None:
    """Move the trim towards its aim, if it may move."""
    if moves and p.on != 0:
        most = p.rate * p.period_s
        s.trim += min(max(s.aim - s.trim, -most), most)


@njit(cache=True, nogil=True)
def _judge(p: Any, s: Any, reading: float, predicted: float) -> int:
    """Return why this reading must not be used, or NOTHING."""
    if math.isnan(reading) or math.isnan(predicted):
        s.seen = math.nan
        return NO_READING
    dt = min(s.since_s, 10.0 * p.jump_s)
    if math.isnan(s.predicted):
        s.predicted = predicted
    s.moved = s.moved * p.jump_s / (p.jump_s + dt) + abs(predicted - s.predicted)
    s.predicted = predicted
    if reading != s.reading:
        s.reading, s.predicted_then, s.aim_then = reading, predicted, s.aim
        s.stuck = 0
    elif abs(predicted - s.predicted_then) > p.stuck:
        s.stuck = 1
    difference = reading - predicted
    if math.isnan(s.seen):
        s.seen = difference
    s.seen += dt / (TUNING.reported_s + dt) * (difference - s.seen)
    if s.stuck != 0:
        return STUCK
    beyond = abs(difference) > p.belief
    if math.isnan(s.difference):
        if beyond:
            return BEYOND
        s.difference = difference
    if s.new_s < TUNING.new_s and not beyond:
        # drive history that the model lacks shows here; it is not a jump of the reading
        s.new_s += dt
        s.difference = difference
    off = difference - s.difference
    if abs(off) > p.jump + TUNING.jump_share * s.moved:
        s.out_s, s.in_s = s.out_s + dt, 0.0
        if s.out_s >= p.jump_s and s.jumped == 0:
            s.jumped = 1
            s.jumped_s, s.anew, s.anew_s = s.age_s, math.nan, 0.0
            s.aim = s.trim
    else:
        s.in_s, s.out_s = s.in_s + dt, 0.0
        s.difference += dt / (p.jump_s + dt) * off
        if s.in_s >= TUNING.back_s:
            s.jumped = 0
    if beyond:
        s.anew = math.nan
        return BEYOND
    if s.jumped != 0:
        return _judge_jumped_reading(p, s, dt)
    if math.isnan(s.usual):
        s.usual = difference
    if s.out_s == 0.0:
        s.usual += dt / (TUNING.usual_s + dt) * (difference - s.usual)
    return NOTHING


@njit(cache=True, nogil=True)
def _judge_jumped_reading(p: Any, s: Any, dt: float) -> int:
    """Return JUMPED or SETTLING, or NOTHING once a reading that jumped is settled and plausible."""
    unsettled = TUNING.settled * p.jump + TUNING.jump_share * s.moved
    if math.isnan(s.anew) or abs(s.seen - s.anew) > unsettled:
        s.anew, s.anew_s = s.seen, 0.0
    s.anew += dt / (TUNING.reported_s + dt) * (s.seen - s.anew)
    s.anew_s += dt
    most = p.limit if s.jumped_s < TUNING.young_s else p.jump
    if abs(s.anew) > most and not abs(s.anew - s.usual) <= p.jump:
        return JUMPED
    if s.anew_s < TUNING.settled_s:
        return SETTLING
    s.difference, s.jumped, s.out_s, s.in_s = s.anew, 0, 0.0, 0.0
    return NOTHING
