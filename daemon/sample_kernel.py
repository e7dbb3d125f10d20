"""What surrounds the step in a sample, for both engines: requests and commands before it,
deadlines, causes, histograms and the telemetry ring after it.

    begin -> (voltage to write, or NaN) -> the caller writes -> finish
"""

from typing import Any

from numba import njit

from dehyst.daemon import controls as at
from dehyst.daemon import systemcalls, ticks
from dehyst.daemon.controls import Note
from dehyst.daemon.histogram import count
from dehyst.daemon.records import Flag, MissCause, State
from dehyst.daemon.ring import HEAD, TAIL, load, store
from dehyst.daemon.step_kernel import fault, recovered, step, stop, swap, written
from dehyst.daemon.tables import (
    NAN,
    Table,
    command_ring_of,
    commands_of,
    control_of,
    meter_of,
    note,
    plan_of,
    record_of,
    ring_of,
)
from dehyst.daemon.witness import excuse
from dehyst.drivers.direct import floats_at, whole_at, whole_grid_at

READY, FAULT = int(State.READY), int(State.FAULT)
MISSED, WRITE_FAILED = int(Flag.MISSED), int(Flag.WRITE_FAILED)
COMMANDS_LOST, RELOADED = int(Note.COMMANDS_LOST), int(Note.RELOADED)
PAGE_FAULT, PREEMPTED = int(MissCause.PAGE_FAULT), int(MissCause.PREEMPTED)
DRIVER_IO, COMPUTE = int(MissCause.DRIVER_IO), int(MissCause.COMPUTE)
LATE_WAKE = int(MissCause.LATE_WAKE)
NOT_WRITTEN, WRITTEN, REFUSED = 0, 1, 2


@njit(cache=True, nogil=True)
def begin(table: Table) -> float:
    """Take requests and commands, step; the voltage to write, NaN where none is to be written.

    The reading has been put into the meter before.
    """
    m, c, r = meter_of(table), control_of(table), record_of(table)
    now_ns = m.scheduled_ns
    if m.stop != 0:
        stop(table, now_ns)
    if m.swap != 0:
        swap(table, m.swap, m.swap_origin)
        written(table, c.volts)
        note(table, c, RELOADED, m.swap_origin)
        m.swap = 0
    if m.actuator_back != 0:
        recovered(table, now_ns, m.back_v)
        m.actuator_ok, m.actuator_back = 1, 0
    step(table, now_ns, m.measured, _take(table, m, c))
    if c.state == FAULT or m.actuator_ok == 0 or m.doubtful != 0:
        r.volts = c.volts
        return NAN
    if c.state == READY and r.volts == c.volts:
        return NAN  # nobody commands: the bus to the amplifier stays quiet
    return r.volts


@njit(cache=True, nogil=True)
def _take(table: Table, m: Any, c: Any) -> int:
    """Copy new commands from their ring: how many."""
    if table[3 * at.COMMAND_WORDS] == 0:
        return 0
    words = whole_at(table, at.COMMAND_WORDS)
    head = load(words, HEAD)
    if head == m.tail:
        return 0
    ring, out = command_ring_of(table), commands_of(table)
    start = max(m.tail, head - ring.size)
    end = min(head, start + out.size)
    for i in range(start, end):
        out[i - start] = ring[i % ring.size]
    # what the writer may have overwritten while we copied
    safe = load(words, HEAD) - ring.size + 1
    torn = max(0, min(safe - start, end - start))
    for i in range(torn, end - start):
        out[i - torn] = out[i]
    if start + torn > m.tail:
        note(table, c, COMMANDS_LOST, float(start + torn - m.tail))
    m.tail = end
    store(words, TAIL, end)
    return end - start - torn


@njit(cache=True, nogil=True)
def finish(table: Table, wrote: int, flags: int, woke_ns: int, finished_ns: int, io_ns: int) -> int:
    """Close the sample: model, record, deadline, ring. Returns how many deadlines were missed."""
    m, c, p, r = meter_of(table), control_of(table), plan_of(table), record_of(table)
    scheduled_ns = m.scheduled_ns
    if wrote == REFUSED:
        fault(table, scheduled_ns)
        r.volts = c.volts
        flags |= WRITE_FAILED
    written(table, r.volts)
    r.seq, r.scheduled_ns, r.actual_ns = m.samples, scheduled_ns, woke_ns
    r.io_us, r.exec_us = io_ns * 1e-3, (finished_ns - woke_ns) * 1e-3
    late_ns = max(0, woke_ns - scheduled_ns)
    count(whole_at(table, at.WAKE), floats_at(table, at.WAKE_MOST), late_ns * 1e-3)
    count(whole_at(table, at.EXEC), floats_at(table, at.EXEC_MOST), r.exec_us)
    count(whole_at(table, at.IO), floats_at(table, at.IO_MOST), r.io_us)
    m.samples += 1
    missed, m.scheduled_ns = ticks.close(scheduled_ns, p.period_ns, finished_ns)
    buffer = whole_at(table, at.BUFFER)
    major, minor, _, switches = systemcalls.usage(buffer)
    waited = systemcalls.waited_ns(buffer, m.schedstat)
    r.cause, cpu = 0, systemcalls.cpu()
    if missed > 0:
        m.missed += missed
        flags |= MISSED
        cause = _cause(
            table, scheduled_ns, woke_ns, finished_ns, io_ns, major - m.major_faults,
            minor - m.minor_faults, switches - m.switches, waited - m.waited_ns, cpu,
        )  # fmt: skip
        whole_at(table, at.MISSED_BY)[cause] += missed
        r.cause = cause
    m.major_faults, m.minor_faults, m.switches, m.waited_ns = major, minor, switches, waited
    m.cpu = cpu
    r.flags |= flags
    if table[3 * at.TELEMETRY_WORDS] != 0:
        words, ring = whole_at(table, at.TELEMETRY_WORDS), ring_of(table)
        head = words[HEAD]
        ring[head % ring.size] = r
        store(words, HEAD, head + 1)
    return missed


@njit(cache=True, nogil=True)
def _cause(
    table: Table, scheduled_ns: int, woke_ns: int, finished_ns: int, io_ns: int, major: int,
    minor: int, switches: int, waited_ns: int, cpu: int,
) -> int:  # fmt: skip
    """Why a deadline was missed: the largest part of the time that has a known reason."""
    took_ns = finished_ns - scheduled_ns
    cause, excused_ns = 0, 0
    if table[3 * at.WITNESS] != 0:
        logs = whole_grid_at(table, at.WITNESS)
        cause, excused_ns = excuse(logs, cpu, scheduled_ns, finished_ns)
        # the timer was set on the CPU that the loop went to sleep on
        before = meter_of(table).cpu
        if cause == 0 and before != cpu:
            cause, excused_ns = excuse(logs, before, scheduled_ns, finished_ns)
    if 2 * io_ns >= took_ns and 2 * excused_ns < io_ns:
        return DRIVER_IO
    if cause != 0:
        return cause
    if major > 0:
        return PAGE_FAULT
    # ready and without a CPU; a switch alone may have been the witness, which is brief
    if 4 * waited_ns >= took_ns or (waited_ns == 0 and switches > 0):
        return PREEMPTED
    if 2 * (woke_ns - scheduled_ns) >= took_ns:
        return LATE_WAKE
    return PAGE_FAULT if minor > 0 else COMPUTE
