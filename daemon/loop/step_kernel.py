"""One sample of the controller as a kernel, from inputs to record, without clock, device or bus.

    admit commands -> age -> state -> target window -> glide -> inverse -> range, slew -> record

`take_step` does all of this for a single axis. Several axes do it in parts: begin_step for all
axes, then `age`, then make_step (dehyst.daemon.loop.axes.kernels), so the rules exist only once.
All data is in two tables of addresses (dehyst.daemon.loop.records_in_memory).
"""

import math
from typing import Any

import numpy as np
from numba import njit

from dehyst.daemon.loop import targets
from dehyst.daemon.loop.command_kernels import admit, age
from dehyst.daemon.loop.records_in_memory import (
    NAN,
    Note,
    Table,
    add_note,
    as_int64,
    commands_of,
    control_of,
    drop_targets,
    happens,
    points_of,
    queue_of,
    record_of,
    settings_record_of,
    trim_of,
    trim_setting_of,
)
from dehyst.daemon.loop.states import LoopEvent
from dehyst.daemon.rings.records import Flag, Mode, State
from dehyst.models.inverse import sample
from dehyst.models.inverse.state import inverse_at
from dehyst.models.learning import trim
from dehyst.models.learning.freeze_reason import FreezeReason
from dehyst.models.model import Floats

STOP_GRACE_NS = 5_000_000_000  # in addition to the ramp's duration
PAUSE_NS = 1_000_000_000
"""Longest time between two samples that counts towards the end of STOPPING: a loop that was
suspended for longer has not tried to ramp meanwhile."""

# enumerations as integers, which compile faster
READY, RUNNING = as_int64(State.READY), as_int64(State.RUNNING)
HOLDING, STOPPING = as_int64(State.HOLDING), as_int64(State.STOPPING)
END, FAULT = as_int64(LoopEvent.END), as_int64(LoopEvent.FAULT)
ARRIVED = as_int64(LoopEvent.ARRIVED)
RAMP, STAY = as_int64(LoopEvent.RAMP), as_int64(LoopEvent.STAY)
MODE_NONE, MODE_HOLD = as_int64(Mode.NONE), as_int64(Mode.HOLD)
UNREACHABLE, SLEW, RANGE = as_int64(Flag.UNREACHABLE), as_int64(Flag.SLEW), as_int64(Flag.RANGE)
INVALID, OUTSIDE = as_int64(Flag.SENSOR_INVALID), as_int64(Flag.OUTSIDE_VALIDITY)
FALLBACK, APPROACH = as_int64(Flag.FALLBACK), as_int64(Flag.APPROACH)
TRIM_FROZEN = as_int64(Flag.TRIM_FROZEN)
NOTHING, OFF, NOT_RUNNING = (
    as_int64(FreezeReason.NOTHING),
    as_int64(FreezeReason.OFF),
    as_int64(FreezeReason.NOT_RUNNING),
)
NOTES_OF_TRIM = np.array(
    [
        Note.TRIM_GOES_ON,
        0,
        0,
        Note.TRIM_NO_READING,
        Note.TRIM_STUCK,
        Note.TRIM_JUMPED,
        Note.TRIM_BEYOND,
        Note.TRIM_DISTRUSTED,
        Note.TRIM_SETTLING,
    ]
)
"""Notes by Why; 0: no note."""
STOP_FAILED, STOOD_STILL = as_int64(Note.STOP_FAILED), as_int64(Note.STOOD_STILL)
ENDED = as_int64(Note.ENDED)
STILL_NS = 100_000_000  # after a longer pause the stage glides to the target
GLIDE_NS = 100_000_000  # shortest duration of a glide, which also attains the target's speed
MOST_STEEP = 1.5  # largest slope of 3 s^2 - 2 s^3
FIRST_STEP = 0.5
"""Part of the slew limit's step that is allowed from a reported output: reports are off by some
tenths of a volt, which adds to the step. After the first write the output is known."""
BEYOND = sample.BEYOND_SATURATION | sample.BEYOND_DRIVE | sample.BAD_TARGET


@njit(cache=True, nogil=True)
def stop(table: Table, now_ns: int) -> None:
    """Begin to stop: the output goes to its configured state."""
    c, p = control_of(table), settings_record_of(table)
    if happens(c, END, now_ns):
        ramps = abs(p.safe_v - c.volts) / p.ramp_v
        c.stop_left_ns = int(ramps * p.period_ns) + STOP_GRACE_NS
        c.stop_seen_ns = now_ns


@njit(cache=True, nogil=True)
def stopped(table: Table, now_ns: int) -> bool:
    """Return True when the output has reached its state for the daemon's end, or cannot."""
    c, p = control_of(table), settings_record_of(table)
    if c.state != STOPPING:
        return False
    if p.ramp_on_stop == 0 or c.volts == p.safe_v:
        add_note(table, c, ENDED, c.volts)
        return True
    c.stop_left_ns -= min(max(now_ns - c.stop_seen_ns, 0), PAUSE_NS)
    c.stop_seen_ns = now_ns
    if c.stop_left_ns < 0:
        add_note(table, c, STOP_FAILED, c.volts)
        return True
    return False


@njit(cache=True, nogil=True)
def fault(table: Table, now_ns: int) -> None:
    """Handle a failed device: drop targets and write no voltage until `recover`."""
    c = control_of(table)
    if happens(c, FAULT, now_ns):
        drop_targets(c, queue_of(table))


@njit(cache=True, nogil=True)
def recover(table: Table, now_ns: int, volts: float) -> None:
    """Continue after a failure: the devices are back and the output is at `volts`. A stop that a
    client commanded meanwhile is carried out now."""
    c, p = control_of(table), settings_record_of(table)
    c.found = 1
    follow_output(table, volts)
    ramps = p.ramp_on_fault != 0 or c.stop_kept != 0
    c.stop_kept = 0
    if happens(c, RAMP if ramps else STAY, now_ns):
        c.hold_ns = 0 if p.ramp_on_fault != 0 else p.hold_ns


@njit(cache=True, nogil=True)
def swap(table: Table, inverse: int, origin: float) -> None:
    """Use another model, its state already led along the past drive, without an output jump."""
    c, p = control_of(table), settings_record_of(table)
    c.inverse, c.pending = inverse, 0
    p.origin = origin
    c.predicted = inverse_at(inverse).result[0].reading - origin
    trim.forget_trim(trim_of(table))
    c.glide = NAN


@njit(cache=True, nogil=True)
def take_step(table: Table, now_ns: int, measured: float, n_commands: int) -> None:
    """Process one sample at the grid point now_ns: fill the record, write no output.

    measured: sensor reading as model displacement, NaN where invalid; the first n_commands of
    the COMMANDS array are admitted.
    """
    begin_step(table, now_ns, n_commands)
    age(table, control_of(table), settings_record_of(table), now_ns)
    make_step(table, now_ns, measured)


@njit(cache=True, nogil=True)
def begin_step(table: Table, now_ns: int, n_commands: int) -> None:
    """Do the first part of a sample: its commands."""
    c, p = control_of(table), settings_record_of(table)
    c.made = 0
    still_ns = now_ns - c.step_ns if c.step_ns != 0 else 0
    if still_ns > max(STILL_NS, 3 * p.period_ns):
        add_note(table, c, STOOD_STILL, still_ns * 1e-9)
        c.glide = NAN
    c.step_ns = now_ns
    for i in range(n_commands):
        admit(table, c, p, now_ns, commands_of(table)[i])


@njit(cache=True, nogil=True)
def make_step(table: Table, now_ns: int, measured: float) -> None:
    """Do the last part of a sample: the voltage and the record."""
    c, p, r = control_of(table), settings_record_of(table), record_of(table)
    flags, mode = 0, MODE_HOLD
    reading = measured - p.origin + trim_of(table).zero
    flags |= _trim(table, c, reading)
    wanted, target, learned = c.volts, NAN, 0.0
    if c.state == RUNNING:
        wanted, mode, more = _follow(table, c, p, now_ns)
        flags |= more
        target, learned = c.target, c.learned
    elif c.state == HOLDING:
        target = c.target
        if c.stays == 0 and now_ns - c.since_ns >= c.hold_ns:
            target = NAN
            wanted = _ramp(c, p)
            if wanted == p.safe_v and c.volts == p.safe_v:
                drop_targets(c, queue_of(table))
                happens(c, ARRIVED, now_ns)
    elif c.state == STOPPING and p.ramp_on_stop != 0:
        wanted = _ramp(c, p)
    elif c.state == READY:
        mode = MODE_NONE
    volts, limited = _limit(c, p, wanted)
    if volts != c.volts:
        c.found = 0
    flags |= limited
    if math.isnan(measured):
        flags |= INVALID
    r.target, r.measured = target, reading
    r.predicted, r.trim, r.learned = c.predicted, trim_of(table).trim, learned
    r.volts_raw, r.volts = wanted, volts
    r.flags, r.state, r.mode = flags, c.state, mode
    c.made = 1


@njit(cache=True, nogil=True)
def follow_output(table: Table, volts: float) -> None:
    """Advance the model by the applied output `volts`."""
    c, p = control_of(table), settings_record_of(table)
    c.volts = volts
    c.predicted = _applied(c, volts / p.gain) - p.origin


@njit(cache=True, nogil=True)
def _trim(table: Table, c: Any, reading: float) -> int:
    """Update the trim from the gauge; return flags."""
    setting, state = trim_setting_of(table), trim_of(table)
    before = state.lasting
    if trim.take(setting, state, reading, c.predicted, c.held != 0, c.state == RUNNING):
        silent = state.lasting == NOTHING and before in (NOT_RUNNING, OFF)
        words = NOTES_OF_TRIM[state.lasting]
        if words != 0 and not silent:
            add_note(table, c, words, state.seen)
    frozen = setting.on != 0 and c.state == RUNNING and state.why != NOTHING
    return TRIM_FROZEN if frozen else 0


@njit(cache=True, nogil=True)
def _applied(c: Any, drive: float) -> float:
    """Advance the model by one sample at a drive; return its next reading."""
    inverse = inverse_at(c.inverse)
    sample.applied(inverse, drive, c.pending != 0)
    c.pending = 0
    return inverse.result[0].reading


@njit(cache=True, nogil=True)
def _follow(table: Table, c: Any, p: Any, now_ns: int) -> tuple[float, int, int]:
    """Return the inverse's voltage for the present target, its mode, and flags."""
    q, inverse = queue_of(table), inverse_at(c.inverse)
    window, result = inverse.targets, inverse.result[0]
    flags, known = 0, 1
    if q.count > 0:
        known, target, learned = targets.window(q, points_of(table), now_ns, p.period_ns, window)
        if known > 0:
            c.target, c.learned = target, learned
        if now_ns < c.approach_until_ns:
            flags |= APPROACH
    elif c.learned != 0.0:  # the correction learned for a finished trajectory fades
        setting = trim_setting_of(table)
        fade = setting.rate * setting.period_s
        c.learned -= min(max(c.learned, -fade), fade)
    if q.count == 0 or known < 2:
        window[:] = c.target + c.learned
        if q.count > 0:
            flags |= FALLBACK
        known = 2
    window += p.origin + trim_of(table).trim
    if c.pending != 0:
        _applied(c, result.drive)
    if c.glide != 0.0:
        _glide(c, p, result.predicted, window)
        flags |= APPROACH
    # the voltage written now is compared with the next reading, one period ahead
    sample.propose_drive(inverse, window[1:], known - 1)
    c.pending = 1
    volts, bits = result.drive * p.gain, result.flags
    if bits & BEYOND:
        flags |= UNREACHABLE
    if bits & sample.SLEW:
        flags |= SLEW
    if bits & sample.STARVED:
        flags |= FALLBACK
    if bits & sample.OUTSIDE:
        flags |= OUTSIDE
    mode = result.mode
    return volts, MODE_HOLD if mode == sample.HOLD else mode, flags


@njit(cache=True, nogil=True)
def _glide(c: Any, p: Any, stands: float, window: Floats) -> None:
    """Blend the targets with the stage's present position, to avoid a jump: the glide starts at
    rest, ends at the target's speed, and never exceeds the ramp rate."""
    if math.isnan(c.glide):
        samples = MOST_STEEP * abs(window[1] - stands) / p.glide_um
        c.glide, c.glide_from = 1.0, stands
        c.glide_share = 1.0 / max(samples, GLIDE_NS / p.period_ns)
    for i in range(window.size):
        left = max(c.glide - i * c.glide_share, 0.0)
        window[i] += (c.glide_from - window[i]) * left * left * (3.0 - 2.0 * left)
    c.glide = max(c.glide - c.glide_share, 0.0)


@njit(cache=True, nogil=True)
def _ramp(c: Any, p: Any) -> float:
    """Return the voltage one ramp step from the present output towards the safe voltage."""
    return c.volts + min(max(p.safe_v - c.volts, -p.ramp_v), p.ramp_v)


@njit(cache=True, nogil=True)
def _limit(c: Any, p: Any, wanted: float) -> tuple[float, int]:
    """Apply range and slew limit, the last check before the amplifier; return voltage and flags. An
    output that stands outside the range is not moved into it: it goes no further out, and back at
    the pace of what moves it."""
    flags = 0
    if not math.isfinite(wanted):
        return c.volts, RANGE
    volts = min(max(wanted, min(p.min_v, c.volts)), max(p.max_v, c.volts))
    if volts != wanted or not p.min_v <= volts <= p.max_v:
        flags |= RANGE
    most = p.slew_v * (c.move_ns / p.period_ns) * (FIRST_STEP if c.found != 0 else 1.0)
    limited = min(max(volts, c.volts - most), c.volts + most)
    if limited != volts:
        flags |= SLEW
    return limited, flags
