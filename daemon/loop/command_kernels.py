"""Kernels for commands and elapsed time: set-points, trajectory points, requests, staleness.

They are the first part of a sample, see dehyst.daemon.loop.step_kernel.
"""

import math
from typing import Any

from numba import njit

from dehyst.daemon.loop import targets
from dehyst.daemon.loop.records_in_memory import (
    NAN,
    Note,
    Table,
    add_note,
    as_int64,
    drop_targets,
    happens,
    points_of,
    queue_of,
    takes,
    trim_of,
    trim_setting_of,
)
from dehyst.daemon.loop.states import LoopEvent
from dehyst.daemon.rings.records import LARGEST_TARGET, LATEST_OFFSET_NS, LoopCommand, State
from dehyst.models.inverse.state import inverse_at
from dehyst.models.learning import trim

# enumerations as integers, which compile faster
READY, RUNNING = as_int64(State.READY), as_int64(State.RUNNING)
HOLDING, FAULT = as_int64(State.HOLDING), as_int64(State.FAULT)
TARGET, HALT = as_int64(LoopEvent.TARGET), as_int64(LoopEvent.HALT)
RELEASE = as_int64(LoopEvent.RELEASE)
STALE = as_int64(LoopEvent.STALE)
SETPOINT, POINT = as_int64(LoopCommand.SETPOINT), as_int64(LoopCommand.POINT)
CLEAR = as_int64(LoopCommand.CLEAR)
TRUST, ZERO = as_int64(LoopCommand.TRUST), as_int64(LoopCommand.ZERO)
STOP_MOTION, GIVE_BACK = as_int64(LoopCommand.STOP_MOTION), as_int64(LoopCommand.RELEASE)
HOLD, HELD = as_int64(LoopCommand.HOLD), as_int64(Note.HELD)
BAD_VALUE, WITHDRAWN = as_int64(Note.BAD_VALUE), as_int64(Note.WITHDRAWN)
STOPPED, STOP_KEPT = as_int64(Note.STOPPED), as_int64(Note.STOP_KEPT)
RELEASED, POINT_FULL = as_int64(Note.RELEASED), as_int64(Note.POINT_FULL)
POINT_LATE, RUN_DRY = as_int64(Note.POINT_LATE), as_int64(Note.RUN_DRY)
NO_SETPOINT = as_int64(Note.NO_SETPOINT)
GROUP_WAITS = as_int64(Note.GROUP_WAITS)
ZEROED, BAD_CORRECTION = as_int64(Note.ZEROED), as_int64(Note.BAD_CORRECTION)


@njit(cache=True, nogil=True)
def admit(table: Table, c: Any, p: Any, now_ns: int, command: Any) -> None:
    """Execute one COMMAND record."""
    kind, value = command.kind, command.value
    if kind == TRUST:
        trim_of(table).distrusted = 0 if value != 0.0 else 1
        return
    if kind == STOP_MOTION and c.state == FAULT:
        if c.stop_kept == 0:
            add_note(table, c, STOP_KEPT, 0.0)
        c.stop_kept = 1
        return
    if not takes(c, TARGET):
        return  # the gateway refuses these with a message; late ones are dropped here
    if not abs(value) <= LARGEST_TARGET or not abs(command.offset_ns) <= LATEST_OFFSET_NS:
        add_note(table, c, BAD_VALUE, value)
    elif kind == SETPOINT:
        _setpoint(table, c, p, now_ns, value)
        c.stays = 1 if command.last != 0 else 0
    elif kind == POINT:
        _point(table, c, p, now_ns, command)
    elif kind == CLEAR:
        if command.trajectory == queue_of(table).id:
            _hold(table, c, now_ns, WITHDRAWN, p.hold_ns)
    elif kind == STOP_MOTION:
        _hold(table, c, now_ns, STOPPED, p.hold_ns)
    elif kind == HOLD:
        _keep(table, c, p, now_ns, command.last != 0)
    elif kind == GIVE_BACK:
        _release(table, c, p, now_ns)
    elif kind == ZERO:
        trim.move_zero(trim_of(table), value)
        add_note(table, c, ZEROED, value)


@njit(cache=True, nogil=True)
def _position(table: Table, c: Any, p: Any) -> float:
    """Return the stage's present position by the model, corrected by the trim."""
    return inverse_at(c.inverse).result[0].predicted - p.origin - trim_of(table).trim


@njit(cache=True, nogil=True)
def _setpoint(table: Table, c: Any, p: Any, now_ns: int, value: float) -> None:
    q = queue_of(table)
    moving = c.state == RUNNING
    c.target_ns = now_ns
    if moving and q.count == 0:
        c.target = value
        return
    known = moving and not math.isnan(c.target)
    start = c.target + c.learned if known else _position(table, c, p)
    _approach(table, c, p, now_ns, start, value, 0, 0.0, False)
    q.complete = 1
    c.target = value
    happens(c, TARGET, now_ns)


@njit(cache=True, nogil=True)
def _point(table: Table, c: Any, p: Any, now_ns: int, command: Any) -> None:
    q = queue_of(table)
    c.target_ns, c.stays = now_ns, 0
    value, offset_ns, last = command.value, command.offset_ns, command.last != 0
    correction, group = command.correction, command.group
    if command.members < 2:
        group = 0
    if group != 0 and group == c.left:
        return  # this axis has left the group, and reported it
    most = trim_setting_of(table).learned
    if not abs(correction) <= most:
        if c.cut != command.trajectory:  # once for each, or it displaces all other events
            c.cut = command.trajectory
            add_note(table, c, BAD_CORRECTION, correction)
        correction = 0.0 if math.isnan(correction) else min(max(correction, -most), most)
    if command.trajectory != q.id or q.count == 0:
        moving = c.state == RUNNING and not math.isnan(c.target)
        start = c.target + c.learned if moving else _position(table, c, p)
        _approach(table, c, p, now_ns, start, value, offset_ns, correction, last)
        q.id = command.trajectory
        if c.group != 0 and c.group != group and c.trajectory_done == 0:
            c.left = c.group
        c.group = q.group = group
        if group != 0:  # it waits at its first point until the others are at theirs
            q.members, q.stops, q.stop_ns = command.members, targets.LASTING, c.approach_until_ns
        c.trajectory, c.trajectory_done = command.trajectory, 0
        happens(c, TARGET, now_ns)
        return
    points = points_of(table)
    if correction != 0.0:
        c.corrected = 1
    if not targets.append(q, points, offset_ns, value, correction, last):
        full = q.count == points.times.size
        add_note(table, c, POINT_FULL if full else POINT_LATE, offset_ns * 1e-9)


@njit(cache=True, nogil=True)
def _approach(
    table: Table,
    c: Any,
    p: Any,
    now_ns: int,
    start: float,
    value: float,
    offset_ns: int,
    correction: float,
    last: bool,
) -> None:
    """Queue the motion from `start` to a trajectory's first point at the approach speed. It takes
    a whole number of periods, so that trajectory points one period apart fall on samples."""
    q, points = queue_of(table), points_of(table)
    way_s = abs(value + correction - start) / p.approach_um_per_s
    way_ns = p.period_ns * max(1, math.ceil(way_s * 1e9 / p.period_ns - 1e-6))
    targets.clear(q)
    q.start_ns = now_ns + way_ns - offset_ns
    targets.append(q, points, offset_ns - way_ns, start, 0.0, False)
    targets.append(q, points, offset_ns, value, correction, last)
    c.corrected = 1 if correction != 0.0 else 0
    c.approach_until_ns = now_ns + way_ns


@njit(cache=True, nogil=True)
def _hold(table: Table, c: Any, now_ns: int, why: int, hold_ns: int) -> None:
    if happens(c, HALT, now_ns):
        add_note(table, c, why, 0.0)
        targets.clear(queue_of(table))
        c.hold_ns = hold_ns
    elif c.state == HOLDING and c.stays != 0:  # a hold without time limit
        c.since_ns, c.hold_ns, c.stays = now_ns, hold_ns, 0


@njit(cache=True, nogil=True)
def _keep(table: Table, c: Any, p: Any, now_ns: int, stays: bool) -> None:
    """Hold the present voltage during a motion or a ramp; at rest nothing moves anyway."""
    if c.state == READY:
        return
    if c.state == RUNNING:
        add_note(table, c, HELD, 0.0)
    happens(c, HALT, now_ns)
    if c.state == HOLDING:
        drop_targets(c, queue_of(table))
        c.since_ns, c.hold_ns, c.stays = now_ns, p.hold_ns, 1 if stays else 0


@njit(cache=True, nogil=True)
def _release(table: Table, c: Any, p: Any, now_ns: int) -> None:
    if c.state == READY and c.volts == p.safe_v:
        return  # it is at its safe voltage already
    if c.state != READY:
        add_note(table, c, RELEASED, 0.0)
    happens(c, RELEASE, now_ns)
    targets.clear(queue_of(table))
    c.hold_ns, c.stays = 0, 0


@njit(cache=True, nogil=True)
def age(table: Table, c: Any, p: Any, now_ns: int) -> None:
    """Handle trajectories that end or run dry, and set-points that go stale."""
    if c.state != RUNNING:
        return
    q, points = queue_of(table), points_of(table)
    times = points.times
    if targets.finished(q, times, now_ns):
        end = targets.end_ns(q, times) + q.shift_ns
        newest = (q.first + q.count - 1) % times.size
        c.target, c.learned = points.values[newest], points.corrections[newest]
        c.target_ns = max(c.target_ns, end)
        if q.id != 0:
            c.trajectory_done = 1
        targets.clear(q)
    starved = targets.starved(q, times, now_ns)
    if starved and c.starved == 0:
        c.target_ns = now_ns
        add_note(table, c, GROUP_WAITS if q.dry == targets.OTHER else RUN_DRY, 0.0)
    elif c.starved != 0 and not starved and q.count > 0 and q.group == 0:
        c.glide = NAN  # time went on meanwhile; a group's time paused
    c.starved = 1 if starved else 0
    if c.stays == 0 and (starved or q.count == 0) and now_ns - c.target_ns > p.stale_ns:
        add_note(table, c, NO_SETPOINT, p.stale_ns * 1e-9)
        targets.clear(q)
        c.hold_ns = p.hold_ns
        happens(c, STALE, now_ns)
