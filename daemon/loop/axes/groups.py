"""Kernels for a trajectory that several axes play together: they start, pause and hold together.

Each member has its own queue; all queues have the same time zero. A member at its first point waits
there until all members are at theirs. They start one preview length later, so that every plan sees
the motion in advance. When one member runs out of points, trajectory time pauses for all
(QUEUE_T.shift_ns), so that nothing jumps when it continues. When one leaves before its end (fault,
release, stop, other commands), the others hold. A member that waits longer than setpoint.stale_s
holds, too, as in any trajectory that has run dry.
"""

import numpy as np
from numba import njit
from numpy.typing import NDArray

from dehyst.daemon.loop import targets
from dehyst.daemon.loop.records_in_memory import (
    N_TABLE,
    Note,
    Table,
    add_note,
    as_int64,
    control_of,
    happens,
    points_of,
    queue_of,
    settings_record_of,
)
from dehyst.daemon.loop.states import LoopEvent
from dehyst.daemon.rings.records import State
from dehyst.models.addresses import table_at
from dehyst.models.inverse.state import inverse_at

RUNNING, FAULT = as_int64(State.RUNNING), as_int64(State.FAULT)
HALT, GROUP_BROKEN = as_int64(LoopEvent.HALT), as_int64(Note.GROUP_BROKEN)


@njit(cache=True, nogil=True)
def coordinate(axes: NDArray[np.int64], now_ns: int) -> None:
    """Let each group start, continue, pause or hold, before the targets of this sample."""
    for i in range(axes.size):
        _leave(table_at(axes[i], N_TABLE))
    for i in range(axes.size):
        q = queue_of(table_at(axes[i], N_TABLE))
        if q.group == 0 or _is_seen(axes, i):
            continue
        if _is_left(axes, q.group):
            _hold_all(axes, q.group, now_ns)
        elif q.started == 0:
            _gather(axes, q.group, now_ns)
        else:
            _keep_together(axes, q.group, now_ns)


@njit(cache=True, nogil=True)
def _is_seen(axes: NDArray[np.int64], place: int) -> bool:
    """Return whether an earlier axis belongs to the same group."""
    group, found = queue_of(table_at(axes[place], N_TABLE)).group, False
    for i in range(place):
        found |= queue_of(table_at(axes[i], N_TABLE)).group == group
    return found


@njit(cache=True, nogil=True)
def _leave(table: Table) -> None:
    """Record that an axis no longer plays its group's trajectory."""
    c, q = control_of(table), queue_of(table)
    if c.group == 0:
        return
    playing = c.state == RUNNING and q.group == c.group
    done = c.trajectory_done != 0 and c.state != FAULT
    if not playing and not done:
        c.left = c.group
        c.group = 0


@njit(cache=True, nogil=True)
def _is_left(axes: NDArray[np.int64], group: int) -> bool:
    found = False
    for i in range(axes.size):
        found |= control_of(table_at(axes[i], N_TABLE)).left == group
    return found


@njit(cache=True, nogil=True)
def _hold_all(axes: NDArray[np.int64], group: int, now_ns: int) -> None:
    for i in range(axes.size):
        table = table_at(axes[i], N_TABLE)
        c, q = control_of(table), queue_of(table)
        if q.group == group:
            if happens(c, HALT, now_ns):
                add_note(table, c, GROUP_BROKEN, 0.0)
                c.hold_ns = settings_record_of(table).hold_ns
            targets.clear(q)
            c.left = group
            c.group = 0


@njit(cache=True, nogil=True)
def _gather(axes: NDArray[np.int64], group: int, now_ns: int) -> None:
    """Let members that have arrived wait; start all when the last one has arrived."""
    there, arrived, ahead_ns, first_ns = 0, 0, 0, targets.FAR_NS
    wanted = 0
    for i in range(axes.size):
        table = table_at(axes[i], N_TABLE)
        q = queue_of(table)
        if q.group != group or q.started != 0:
            continue
        there += 1
        wanted = q.members
        if now_ns - q.shift_ns >= q.stop_ns:
            arrived += 1
        preview = inverse_at(control_of(table).inverse).targets.size
        ahead_ns = max(ahead_ns, preview * settings_record_of(table).period_ns)
        first_ns = min(first_ns, q.stop_ns - q.start_ns)
    for i in range(axes.size):
        table = table_at(axes[i], N_TABLE)
        c, q = control_of(table), queue_of(table)
        if q.group != group or q.started != 0 or now_ns - q.shift_ns < q.stop_ns:
            continue
        targets.drop_until(q, points_of(table).times, q.stop_ns)
        if there >= wanted and arrived == there:
            q.shift_ns = now_ns + ahead_ns - first_ns - q.start_ns
            c.approach_until_ns = q.stop_ns + q.shift_ns
            q.started, q.stops, q.dry = 1, targets.NOT, 0
        else:
            q.shift_ns = now_ns - q.stop_ns
            c.approach_until_ns = now_ns + 1
            q.dry = targets.OTHER if there < wanted else 0


@njit(cache=True, nogil=True)
def _keep_together(axes: NDArray[np.int64], group: int, now_ns: int) -> None:
    """Pause time where the first member runs out of points, so that no member plays further."""
    horizon_ns = targets.FAR_NS  # since the trajectory's time zero
    for i in range(axes.size):
        table = table_at(axes[i], N_TABLE)
        q = queue_of(table)
        if q.group == group and q.started != 0 and q.complete == 0:
            end_ns = targets.end_ns(q, points_of(table).times)
            horizon_ns = min(horizon_ns, end_ns - q.start_ns)
    for i in range(axes.size):
        table = table_at(axes[i], N_TABLE)
        q = queue_of(table)
        if q.group != group:
            continue
        if q.started == 0:
            q.dry = targets.OTHER  # joined too late: it goes stale at its first point
            continue
        q.stops, q.dry = targets.NOT, 0
        if horizon_ns == targets.FAR_NS:
            continue
        q.stops, q.stop_ns = targets.OPEN, q.start_ns + horizon_ns
        beyond_ns = now_ns - q.shift_ns - q.stop_ns
        if beyond_ns > 0:
            q.shift_ns += beyond_ns
            own = q.complete == 0 and targets.end_ns(q, points_of(table).times) == q.stop_ns
            q.dry = targets.OWN if own else targets.OTHER
