"""Kernels around the step of a sample, for both loops: requests and commands before it; deadlines,
causes, histograms and the telemetry ring after it.

    take_requests -> make_voltage (NaN: write nothing) -> the caller writes -> finish

With several axes, dehyst.daemon.loop.axes.kernels runs what comes between the first two.
"""

from typing import Any, NamedTuple

from numba import njit

from dehyst.daemon.loop import records_in_memory as at
from dehyst.daemon.loop import systemcalls
from dehyst.daemon.loop.records_in_memory import (
    NAN,
    Note,
    Table,
    add_note,
    as_int64,
    bytes_at,
    command_ring_of,
    commands_of,
    control_of,
    meter_of,
    record_of,
    ring_of,
    settings_record_of,
)
from dehyst.daemon.loop.step_kernel import (
    begin_step,
    fault,
    follow_output,
    make_step,
    recover,
    stop,
    swap,
)
from dehyst.daemon.loop.timing import deadlines
from dehyst.daemon.loop.timing.histogram import count
from dehyst.daemon.loop.timing.witness import excuse
from dehyst.daemon.rings.layout import FARTHEST, HEAD, TAIL
from dehyst.daemon.rings.records import Flag, MissCause, State
from dehyst.daemon.rings.ring import digest, load_word, store
from dehyst.models.addresses import floats_at, whole_at, whole_grid_at

READY, FAULT = as_int64(State.READY), as_int64(State.FAULT)
MISSED, WRITE_FAILED = as_int64(Flag.MISSED), as_int64(Flag.WRITE_FAILED)
COMMANDS_LOST, RELOADED = as_int64(Note.COMMANDS_LOST), as_int64(Note.RELOADED)
COMMANDS_DAMAGED = as_int64(Note.COMMANDS_DAMAGED)
PAGE_FAULT, PREEMPTED = as_int64(MissCause.PAGE_FAULT), as_int64(MissCause.PREEMPTED)
DRIVER_IO, COMPUTE = as_int64(MissCause.DRIVER_IO), as_int64(MissCause.COMPUTE)
LATE_WAKE = as_int64(MissCause.LATE_WAKE)
NOT_WRITTEN, WRITTEN, NOT_TAKEN = 0, 1, 2
ANSWER_NS = 200_000
"""Time allowed between the output's change and the end of the call that made it: the
acknowledgement passes through a serial port and the scheduler."""
ENOUGH = 100
"""Number of writes after which the shortest duration is known."""


@njit(cache=True, nogil=True)
def take_requests(table: Table, clock_ns: int) -> None:
    """Take requests and commands.

    clock_ns: the present time, which may be late. The slew limit holds by the clock, so a sample
    soon after a late one moves less.
    """
    m, c, p = meter_of(table), control_of(table), settings_record_of(table)
    now_ns = m.scheduled_ns
    since_ns = clock_ns - c.wrote_ns if c.wrote_ns != 0 else p.period_ns
    c.move_ns = min(max(since_ns, 0), p.period_ns)
    c.held = m.held
    if m.stop != 0:
        stop(table, now_ns)
    if m.swap != 0:
        swap(table, m.swap, m.swap_origin)
        table[3 * at.FOLLOWS], table[3 * at.FOLLOWS + 1] = m.swap_rows, m.swap_n_rows
        follow_output(table, c.volts)
        add_note(table, c, RELOADED, m.swap_origin)
        m.swap = 0
    if m.actuator_back != 0:
        recover(table, now_ns, m.back_v)
        # a write that it accepted last may have changed the output just now
        c.wrote_ns, c.move_ns = clock_ns, 0
        m.actuator_ok, m.actuator_back = 1, 0
    begin_step(table, now_ns, _take(table, m, c))


@njit(cache=True, nogil=True)
def make_voltage(table: Table) -> float:
    """Make the step; return the voltage to write, NaN: write nothing. The reading must be in the
    meter already."""
    m, c, r = meter_of(table), control_of(table), record_of(table)
    make_step(table, m.scheduled_ns, m.measured)
    if c.state == FAULT or m.actuator_ok == 0 or m.doubtful != 0:
        r.volts = c.volts
        return NAN
    if r.volts == c.volts and (c.state == READY or c.found != 0):
        return NAN  # no client commands, or the device reports this voltage, which may be off
    return r.volts


@njit(cache=True, nogil=True)
def _take(table: Table, m: Any, c: Any) -> int:
    """Copy new commands from their ring; return their number."""
    if table[3 * at.COMMAND_WORDS] == 0:
        return 0
    words = whole_at(table, at.COMMAND_WORDS)
    head = load_word(words, HEAD)
    if head == m.tail:
        return 0
    ring, out = command_ring_of(table), commands_of(table)
    data, checks = bytes_at(table, at.COMMAND_DATA), whole_at(table, at.COMMAND_CHECKS)
    if not 0 <= head - m.tail < FARTHEST:  # overwritten: the gateway continues from the tail
        add_note(table, c, COMMANDS_DAMAGED, 1.0)
        store(words, HEAD, m.tail)
        return 0
    start = max(m.tail, head - ring.size)
    end = min(head, start + out.size)
    taken = 0
    for i in range(start, end):
        place = i % ring.size
        out[taken] = ring[place]
        # checked after the copy: a record overwritten meanwhile has another number
        if checks[place] == digest(data[place], i):
            taken += 1
    if start > m.tail:
        add_note(table, c, COMMANDS_LOST, float(start - m.tail))
    if taken < end - start:
        add_note(table, c, COMMANDS_DAMAGED, float(end - start - taken))
    m.tail = end
    store(words, TAIL, end)
    return taken


@njit(cache=True, nogil=True)
def finish(
    table: Table,
    wrote: int,
    flags: int,
    woke_ns: int,
    finished_ns: int,
    io_ns: int,
    written_ns: int,
    call_ns: int,
) -> int:
    """Close the sample: model, record, deadline, ring. Return how many deadlines were missed.

    finished_ns, io_ns: of all axes; written_ns: end of this axis' write; call_ns: the least time
    that its call takes.
    """
    m, c, p, r = meter_of(table), control_of(table), settings_record_of(table), record_of(table)
    scheduled_ns = m.scheduled_ns
    if wrote == NOT_TAKEN:
        fault(table, scheduled_ns)
        r.volts = c.volts
        flags |= WRITE_FAILED
    if wrote != NOT_WRITTEN:
        c.wrote_ns = written_ns - (_least_delay_ns(c.least_ns) if c.writes > ENOUGH else 0)
    if wrote == WRITTEN:
        c.least_ns = call_ns if c.writes == 0 else min(call_ns, c.least_ns)
        c.writes += 1
    follow_output(table, r.volts)
    r.seq, r.scheduled_ns, r.actual_ns = m.samples, scheduled_ns, woke_ns
    r.io_us, r.exec_us = io_ns * 1e-3, (finished_ns - woke_ns) * 1e-3
    late_ns = max(0, woke_ns - scheduled_ns)
    count(whole_at(table, at.WAKE), floats_at(table, at.WAKE_MOST), late_ns * 1e-3)
    count(whole_at(table, at.EXEC), floats_at(table, at.EXEC_MOST), r.exec_us)
    count(whole_at(table, at.IO), floats_at(table, at.IO_MOST), r.io_us)
    m.samples += 1
    missed, m.scheduled_ns = deadlines.close(scheduled_ns, p.period_ns, finished_ns)
    buffer = whole_at(table, at.BUFFER)
    major, minor, _, switches = systemcalls.usage(buffer)
    waited = systemcalls.waited_ns(buffer, m.schedstat)
    r.cause, cpu = 0, systemcalls.cpu()
    if missed > 0:
        m.missed += missed
        flags |= MISSED
        spent = ThreadUsage(
            major - m.major_faults,
            minor - m.minor_faults,
            switches - m.switches,
            waited - m.waited_ns,
            io_ns,
            cpu,
        )
        cause = _cause(table, scheduled_ns, woke_ns, finished_ns, spent)
        whole_at(table, at.MISSED_BY)[cause] += missed
        r.cause = cause
    m.major_faults, m.minor_faults, m.switches, m.waited_ns = major, minor, switches, waited
    m.cpu = cpu
    r.flags |= flags
    if table[3 * at.TELEMETRY_WORDS] != 0:
        words, ring = whole_at(table, at.TELEMETRY_WORDS), ring_of(table)
        data, checks = bytes_at(table, at.TELEMETRY_DATA), whole_at(table, at.TELEMETRY_CHECKS)
        head = m.samples - 1  # its own count, even if the file was changed
        place = head % ring.size
        ring[place] = r
        checks[place] = digest(data[place], head)
        store(words, HEAD, head + 1)
    return missed


class ThreadUsage(NamedTuple):
    """Usage of the thread since the previous sample: page faults, context switches, time ready
    without a CPU, time in the drivers; and the CPU that it runs on."""

    major: int
    minor: int
    switches: int
    waited_ns: int
    io_ns: int
    cpu: int


@njit(cache=True, nogil=True)
def _least_delay_ns(least_ns: int) -> int:
    """Return the least time from the start of a write to the change of the output.

    A slow call may change the output at its end, and the next call may change it early. So that no
    time window exceeds the slew limit, time counts from the end of one call to the earliest change
    by the next, which comes after the shortest call minus the acknowledgement time.
    """
    return max(least_ns - ANSWER_NS, least_ns // 2)


@njit(cache=True, nogil=True)
def _cause(
    table: Table,
    scheduled_ns: int,
    woke_ns: int,
    finished_ns: int,
    spent: ThreadUsage,
) -> int:
    """Return why a deadline was missed: the known reason for the largest part of the time."""
    took_ns = finished_ns - scheduled_ns
    cause, excused_ns = 0, 0
    if table[3 * at.WITNESS] != 0:
        logs = whole_grid_at(table, at.WITNESS)
        cause, excused_ns = excuse(logs, spent.cpu, scheduled_ns, finished_ns)
        # the timer was set on the CPU on which the loop went to sleep
        before = meter_of(table).cpu
        if cause == 0 and before != spent.cpu:
            cause, excused_ns = excuse(logs, before, scheduled_ns, finished_ns)
    if 2 * spent.io_ns >= took_ns and 2 * excused_ns < spent.io_ns:
        return DRIVER_IO
    if cause != 0:
        return cause
    if spent.major > 0:
        return PAGE_FAULT
    # ready but without a CPU; a switch alone may be due to the witness, which is brief
    if 4 * spent.waited_ns >= took_ns or (spent.waited_ns == 0 and spent.switches > 0):
        return PREEMPTED
    if 2 * (woke_ns - scheduled_ns) >= took_ns:
        return LATE_WAKE
    return PAGE_FAULT if spent.minor > 0 else COMPUTE
