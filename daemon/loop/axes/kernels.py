"""Kernels that coordinate the axes of a controller within a sample.

    requests and commands of all -> groups -> what each follows of the others -> voltages

A controller of one axis uses the same path. axes: (n,) addresses of the axes' tables
(dehyst.daemon.loop.records_in_memory), in the order of the configuration.

A model's channel may be another axis' displacement or drive in the same sample: all targets are
known before the first voltage is computed, and an axis that follows a drive comes after the one
that it follows. In a circle of drives, the first axis uses the drive of the previous sample.
"""

import math

import numpy as np
from numba import njit
from numpy.typing import NDArray

from dehyst.daemon.loop import targets
from dehyst.daemon.loop.axes import groups
from dehyst.daemon.loop.command_kernels import age
from dehyst.daemon.loop.records_in_memory import (
    FOLLOWS,
    N_TABLE,
    Table,
    as_int64,
    control_of,
    follows_of,
    meter_of,
    points_of,
    queue_of,
    record_of,
    settings_record_of,
    trim_of,
)
from dehyst.daemon.loop.sample import make_voltage, take_requests
from dehyst.daemon.rings.records import Flag, State
from dehyst.models.addresses import table_at
from dehyst.models.inverse.state import inverse_at

RUNNING = as_int64(State.RUNNING)
HELD_BACK = as_int64(Flag.UNREACHABLE | Flag.SLEW | Flag.RANGE)


@njit(cache=True, nogil=True)
def axis_at(address: int) -> Table:
    """Return the table of an axis."""
    return table_at(address, N_TABLE)


@njit(cache=True, nogil=True)
def begin_axes(axes: NDArray[np.int64], clock_ns: int, volts: NDArray[np.float64]) -> None:
    """Compute one sample of all axes up to their voltages, into volts (n,); NaN: write nothing. The
    readings must be in the meters already. clock_ns: as in take_requests."""
    for i in range(axes.size):
        take_requests(axis_at(axes[i]), clock_ns)
    now_ns = meter_of(axis_at(axes[0])).scheduled_ns
    groups.coordinate(axes, now_ns)
    for i in range(axes.size):
        table = axis_at(axes[i])
        age(table, control_of(table), settings_record_of(table), now_ns)
    for _ in range(axes.size):
        i = next_axis(axes)
        table = axis_at(axes[i])
        follow_axes(table, now_ns)
        volts[i] = make_voltage(table)


@njit(cache=True, nogil=True)
def next_axis(axes: NDArray[np.int64]) -> int:
    """Return the axis whose voltage is made next: the first whose followed drives have been made;
    in a circle, the first remaining axis."""
    first = -1
    for i in range(axes.size):
        table = axis_at(axes[i])
        if control_of(table).made != 0:
            continue
        if first < 0:
            first = i
        waits = False
        for k in range(table[3 * FOLLOWS + 1]):
            row = follows_of(table)[k]
            waits |= row.drive != 0 and control_of(axis_at(row.axis)).made == 0
        if not waits:
            return i
    return first


@njit(cache=True, nogil=True)
def follow_axes(table: Table, now_ns: int) -> None:
    """Write what this axis' model follows of other axes to its channels."""
    channels = inverse_at(control_of(table).inverse).channels
    for k in range(table[3 * FOLLOWS + 1]):
        row = follows_of(table)[k]
        other = axis_at(row.axis)
        value = drive_of(other) if row.drive != 0 else displacement_of(other, now_ns)
        if math.isfinite(value):
            channels[row.channel] = value * row.scale + row.zero


@njit(cache=True, nogil=True)
def displacement_of(table: Table, now_ns: int) -> float:
    """Return an axis' displacement one period ahead in its model's coordinates (set-point plus
    origin, as in a recording of its gauge), without trim and learned correction. It is the target;
    where none is followed (no target, limited, gliding), the model's prediction."""
    c, p, q = control_of(table), settings_record_of(table), queue_of(table)
    held_back = record_of(table).flags & HELD_BACK
    if c.state != RUNNING or held_back != 0 or c.glide != 0.0:
        return c.predicted + p.origin - trim_of(table).trim
    if q.count > 0:
        return targets.queued_target(q, points_of(table), now_ns + p.period_ns) + p.origin
    return c.target + p.origin


@njit(cache=True, nogil=True)
def drive_of(table: Table) -> float:
    """Return an axis' drive [its model's drive unit]: of this sample if made, else the last one."""
    c = control_of(table)
    volts = record_of(table).volts if c.made != 0 else c.volts
    return volts / settings_record_of(table).gain
