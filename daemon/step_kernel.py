"""One sample of the controller as a kernel: inputs in, record out. No clock, device or bus.

    admit commands -> age -> state -> target window -> inverse -> bump, range, slew -> record

Both engines and the tests call `step` and `written` here; there is no second copy of the rules.
Everything it works on lies in two tables of addresses (dehyst.daemon.controls).
"""

import math
from typing import Any

from numba import njit

from dehyst.daemon import controls as at
from dehyst.daemon import targets
from dehyst.daemon.command_kernel import admit, age
from dehyst.daemon.controls import Note
from dehyst.daemon.records import Flag, Mode, State
from dehyst.daemon.tables import (
    NAN,
    Table,
    commands_of,
    control_of,
    drop_targets,
    enter,
    note,
    plan_of,
    queue_of,
    record_of,
)
from dehyst.drivers.direct import floats_at, grid_at, table_at, whole_at, whole_grid_at
from dehyst.models import compensate

STOP_GRACE_NS = 5_000_000_000  # beyond the ramp's own time

# enumerations as plain integers, which compile in less time
READY, RUNNING = int(State.READY), int(State.RUNNING)
HOLDING, FAULT, STOPPING = int(State.HOLDING), int(State.FAULT), int(State.STOPPING)
MODE_NONE, MODE_HOLD = int(Mode.NONE), int(Mode.HOLD)
UNREACHABLE, SLEW, RANGE = int(Flag.UNREACHABLE), int(Flag.SLEW), int(Flag.RANGE)
INVALID, OUTSIDE = int(Flag.SENSOR_INVALID), int(Flag.OUTSIDE_VALIDITY)
FALLBACK, APPROACH = int(Flag.FALLBACK), int(Flag.APPROACH)
STOP_FAILED, STOOD_STILL = int(Note.STOP_FAILED), int(Note.STOOD_STILL)
STILL_NS = 100_000_000  # a loop that stood still for longer glides to where the target has gone
BEYOND = compensate.BEYOND_SATURATION | compensate.BEYOND_DRIVE | compensate.BAD_TARGET


@njit(cache=True, nogil=True)
def stop(table: Table, now_ns: int) -> None:
    """Begin to end: the output goes to its configured state."""
    c, p = control_of(table), plan_of(table)
    if c.state != STOPPING:
        enter(c, STOPPING, now_ns)
        ramps = abs(p.safe_v - c.volts) / p.ramp_v
        c.stop_by_ns = now_ns + int(ramps * p.period_ns) + STOP_GRACE_NS


@njit(cache=True, nogil=True)
def stopped(table: Table, now_ns: int) -> bool:
    """True when the output has reached its state at the end of the daemon, or cannot."""
    c, p = control_of(table), plan_of(table)
    if c.state != STOPPING:
        return False
    if p.ramp_on_stop == 0 or c.volts == p.safe_v:
        return True
    if now_ns > c.stop_by_ns:
        note(table, c, STOP_FAILED, c.volts)
        return True
    return False


@njit(cache=True, nogil=True)
def fault(table: Table, now_ns: int) -> None:
    """A device failed: drop targets, no further voltage until `recovered`."""
    c = control_of(table)
    if c.state != FAULT and c.state != STOPPING:
        drop_targets(c, queue_of(table))
        enter(c, FAULT, now_ns)


@njit(cache=True, nogil=True)
def recovered(table: Table, now_ns: int, volts: float) -> None:
    """The devices are back and the output stands at `volts`."""
    c, p = control_of(table), plan_of(table)
    written(table, volts)
    if c.state == FAULT:
        c.hold_ns = 0 if p.ramp_on_fault != 0 else p.hold_ns
        enter(c, HOLDING if p.ramp_on_fault != 0 else READY, now_ns)


@njit(cache=True, nogil=True)
def swap(table: Table, inverse: int, origin: float) -> None:
    """Another model, its state already led along the past drive; the output does not jump."""
    c, p = control_of(table), plan_of(table)
    c.inverse, c.pending = inverse, 0
    p.origin = origin
    c.bump = NAN  # taken from the first voltage of the new model


@njit(cache=True, nogil=True)
def step(table: Table, now_ns: int, measured: float, n_commands: int) -> None:
    """Take one sample at the grid point now_ns: fills the record, moves nothing.

    measured: sensor reading as model displacement, NaN where invalid; the first n_commands of
    the COMMANDS array are admitted.
    """
    c, p, r = control_of(table), plan_of(table), record_of(table)
    flags, mode = 0, MODE_HOLD
    still_ns = now_ns - c.step_ns if c.step_ns != 0 else 0
    if still_ns > max(STILL_NS, 3 * p.period_ns):
        note(table, c, STOOD_STILL, still_ns * 1e-9)
        c.bump = NAN
    c.step_ns = now_ns
    for i in range(n_commands):
        admit(table, c, p, now_ns, commands_of(table)[i])
    age(table, c, p, now_ns)
    wanted, target = c.volts, NAN
    if c.state == RUNNING:
        wanted, mode, flags = _follow(table, c, p, now_ns)
        target = c.target
    elif c.state == HOLDING:
        target = c.target
        if now_ns - c.since_ns >= c.hold_ns:
            target = NAN
            wanted = _ramp(c, p)
            if wanted == p.safe_v and c.volts == p.safe_v:
                drop_targets(c, queue_of(table))
                enter(c, READY, now_ns)
    elif c.state == STOPPING and p.ramp_on_stop != 0:
        wanted = _ramp(c, p)
    elif c.state == READY:
        mode = MODE_NONE
    volts, limited = _limit(c, p, wanted)
    flags |= limited
    if math.isnan(measured):
        flags |= INVALID
    r.target, r.measured = target, measured - p.origin
    r.predicted = c.predicted
    r.volts_raw, r.volts = wanted, volts
    r.flags, r.state, r.mode = flags, c.state, mode


@njit(cache=True, nogil=True)
def written(table: Table, volts: float) -> None:
    """The output now stands at `volts`; the model follows what was really applied."""
    c, p = control_of(table), plan_of(table)
    c.volts = volts
    c.predicted = _applied(c, volts / p.gain) - p.origin


@njit(cache=True, nogil=True)
def _applied(c: Any, drive: float) -> float:
    """Lead the model by one sample at a drive: its next reading."""
    t = table_at(c.inverse, at.N_INVERSE)
    result = floats_at(t, at.RESULT)
    compensate.applied(
        grid_at(t, at.WEIGHTS), floats_at(t, at.C), floats_at(t, at.KNOTS), floats_at(t, at.FIXED),
        floats_at(t, at.SETTING), whole_grid_at(t, at.BLOCKS), floats_at(t, at.PARAMS),
        floats_at(t, at.NUMBERS), grid_at(t, at.PLAYS), floats_at(t, at.STATES),
        floats_at(t, at.INNER), floats_at(t, at.Y), floats_at(t, at.CHANNELS), drive,
        c.pending != 0, result,
    )  # fmt: skip
    c.pending = 0
    return result[compensate.READING]


@njit(cache=True, nogil=True)
def _follow(table: Table, c: Any, p: Any, now_ns: int) -> tuple[float, int, int]:
    """The inverse's voltage for the present target, its mode, and flags."""
    q, t = queue_of(table), table_at(c.inverse, at.N_INVERSE)
    window, result = floats_at(t, at.WINDOW), floats_at(t, at.RESULT)
    flags, known = 0, 1
    if q.count > 0:
        known = targets.window(
            q, whole_at(table, at.TIMES), floats_at(table, at.VALUES), now_ns, p.period_ns, window
        )
        if known > 0:
            c.target = window[0]
        if now_ns < c.approach_until_ns:
            flags |= APPROACH
    if q.count == 0 or known < 2:
        window[:] = c.target
        if q.count > 0:
            flags |= FALLBACK
        known = 2
    window += p.origin
    if c.pending != 0:
        _applied(c, result[compensate.DRIVE])
    # the voltage written now is judged by the next reading, one period on
    compensate.step(
        grid_at(t, at.WEIGHTS), floats_at(t, at.C), floats_at(t, at.KNOTS), floats_at(t, at.FIXED),
        floats_at(t, at.SETTING), whole_grid_at(t, at.BLOCKS), floats_at(t, at.PARAMS),
        floats_at(t, at.NUMBERS), grid_at(t, at.PLAYS), grid_at(t, at.WORK),
        floats_at(t, at.STATES), floats_at(t, at.SCRATCH), floats_at(t, at.INNER),
        floats_at(t, at.PAST_RING), floats_at(t, at.SEQ), floats_at(t, at.Y), window[1:],
        known - 1, floats_at(t, at.CHANNELS), result,
    )  # fmt: skip
    c.pending = 1
    volts = result[compensate.DRIVE] * p.gain
    if c.bump != 0.0:
        if math.isnan(c.bump):
            c.bump = c.volts - volts
        c.bump -= min(max(c.bump, -p.ramp_v), p.ramp_v)
    bits = int(result[compensate.FLAGS])
    if bits & BEYOND:
        flags |= UNREACHABLE
    if bits & compensate.SLEW:
        flags |= SLEW
    if bits & compensate.STARVED:
        flags |= FALLBACK
    if bits & compensate.OUTSIDE:
        flags |= OUTSIDE
    mode = int(result[compensate.MODE])
    return volts + c.bump, MODE_HOLD if mode == compensate.HOLD else mode, flags


@njit(cache=True, nogil=True)
def _ramp(c: Any, p: Any) -> float:
    """One step from the present output towards the safe voltage."""
    return c.volts + min(max(p.safe_v - c.volts, -p.ramp_v), p.ramp_v)


@njit(cache=True, nogil=True)
def _limit(c: Any, p: Any, wanted: float) -> tuple[float, int]:
    """Range and slew: the last wall before the amplifier."""
    flags = 0
    if not math.isfinite(wanted):
        return c.volts, RANGE
    volts = min(max(wanted, p.min_v), p.max_v)
    if volts != wanted:
        flags |= RANGE
    limited = min(max(volts, c.volts - p.slew_v), c.volts + p.slew_v)
    if limited != volts:
        flags |= SLEW
    return limited, flags
