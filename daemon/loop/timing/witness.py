"""A witness thread that only sleeps, and records when it was woken late.

There is one compiled thread per CPU, without the interpreter, at a higher priority than the loop.
If the loop was late while the witness on its CPU was late, too, the loop is not the cause. The
witness's counters distinguish the causes: the process was stopped, another task had the CPU, or the
machine (hypervisor, firmware, interrupts) paused.
"""

import os
import threading

import numpy as np
from numba import njit
from numpy.typing import NDArray

from dehyst.daemon import clock
from dehyst.daemon.loop.systemcalls import (
    open_schedstat,
    open_stat,
    read_clock_ns,
    read_proc_number,
    sleep_until_ns,
    usage,
    waited_ns,
)
from dehyst.daemon.loop.timing import realtime
from dehyst.daemon.loop.timing.deadlines import next_ns
from dehyst.daemon.rings.records import MissCause

EVENTS = 256  # number of late wake-ups that are kept
STEAL_TICK_NS = 10_000_000  # /proc/stat counts in hundredths of a second
# Each wake-up costs a fast loop microseconds: at 100 us a 10 kHz loop missed twice as many.
SHORTEST_PERIOD_NS, LONGEST_PERIOD_NS = 500_000, 1_000_000
SHORTEST_ODD_NS = 25_000  # smaller lateness is normal
PREEMPTED, STEAL = int(MissCause.PREEMPTED), int(MissCause.STEAL)
STALL, SUSPENDED = int(MissCause.STALL), int(MissCause.SUSPENDED)


@njit(cache=True, nogil=True)
def log_late_wakeups(
    start_ns: int,
    period_ns: int,
    threshold_ns: int,
    schedstat: int,
    stat: int,
    stop: NDArray[np.int64],
    log: NDArray[np.int64],
) -> None:
    """Sleep and wake every period_ns, and log every wake-up that is threshold_ns late.

    stop: (1,) set to 1 to end. log: (1 + 3 EVENTS,): number of late wake-ups, then a ring of
    (wake time ns, lateness ns, MissCause).
    """
    buffer = np.zeros(32, np.int64)
    _, _, slept, _ = usage(buffer)
    waited, steal = waited_ns(buffer, schedstat), read_proc_number(buffer, stat, 8)
    deadline = start_ns
    while stop[0] == 0:
        sleep_until_ns(buffer, deadline)
        now = read_clock_ns(buffer)
        late = now - deadline
        _, _, slept_now, _ = usage(buffer)
        waited_now = waited_ns(buffer, schedstat)
        if late >= threshold_ns:
            cause = STALL
            if 2 * (waited_now - waited) >= late:
                cause = PREEMPTED
            elif slept_now - slept > 1:  # it slept more often than it requested
                cause = SUSPENDED
            elif late >= STEAL_TICK_NS:
                steal_now = read_proc_number(buffer, stat, 8)
                if 2 * (steal_now - steal) * STEAL_TICK_NS >= late:
                    cause = STEAL
                steal = steal_now
            slot = 1 + 3 * (log[0] % EVENTS)
            log[slot], log[slot + 1], log[slot + 2] = now, late, cause
            log[0] += 1
            deadline += (late // period_ns) * period_ns
        slept, waited = slept_now, waited_now
        deadline += period_ns


@njit(cache=True, nogil=True)
def excuse(logs: NDArray[np.int64], cpu: int, from_ns: int, to_ns: int) -> tuple[int, int]:
    """Return (MissCause, lateness [ns]) of the longest late wake-up on a CPU in an interval.

    logs: (CPUs, 1 + 3 EVENTS). The cause is NONE where that CPU's witness was on time or missing.
    """
    cause, longest = 0, 0
    if cpu < 0 or cpu >= logs.shape[0]:
        return cause, longest
    log = logs[cpu]
    for back in range(1, min(log[0], EVENTS) + 1):
        slot = 1 + 3 * ((log[0] - back) % EVENTS)
        woke, late = log[slot], log[slot + 1]
        if woke < from_ns:
            break
        if woke - late <= to_ns and late > longest:
            cause, longest = log[slot + 2], late
    return cause, longest


class Witness:
    """The threads. period_ns: the loop's; grid_ns: one of its deadlines, past or future. The
    witness wakes midway between two deadlines, when the loop has finished.

    `logs`: (CPUs, 1 + 3 EVENTS), for `excuse`; a CPU outside `cpus` has an empty row.
    """

    def __init__(
        self, period_ns: int, cpus: tuple[int, ...], priority: int, grid_ns: int = 0
    ) -> None:
        self.grid_ns = grid_ns
        self.threshold_ns = max(SHORTEST_ODD_NS, period_ns // 4)
        period_ns = min(max(period_ns, SHORTEST_PERIOD_NS), LONGEST_PERIOD_NS)
        self.logs = np.zeros((max(cpus) + 1, 1 + 3 * EVENTS), np.int64)
        self._stop = np.zeros(1, np.int64)
        self._threads = [
            threading.Thread(
                target=self._run,
                args=(cpu, priority, grid_ns + period_ns // 2, period_ns),
                name=f"witness-{cpu}",
                daemon=True,
            )
            for cpu in cpus
        ]
        for thread in self._threads:
            thread.start()

    def _run(self, cpu: int, priority: int, start_ns: int, period_ns: int) -> None:
        os.sched_setaffinity(0, {cpu})
        if priority:
            try:
                os.sched_setscheduler(0, os.SCHED_FIFO, os.sched_param(min(priority + 1, 99)))
            except OSError:
                priority = 0  # no privilege: the loop has none either
        realtime.finest_timer()
        start_ns = next_ns(start_ns, clock.monotonic_ns() + period_ns, period_ns)
        log_late_wakeups(
            start_ns,
            period_ns,
            self.threshold_ns,
            open_schedstat(),
            open_stat(),
            self._stop,
            self.logs[cpu],
        )

    def seen(self) -> list[tuple[int, int, MissCause]]:
        """Return (wake time ns, lateness ns, cause) of the kept late wake-ups on all CPUs."""
        found = []
        for log in self.logs:
            rows = log[1 : 1 + 3 * min(int(log[0]), EVENTS)].reshape(-1, 3)
            found += [(int(t), int(late), MissCause(int(cause))) for t, late, cause in rows]
        return sorted(found)

    @property
    def count(self) -> int:
        """Return the number of late wake-ups on all CPUs."""
        return int(self.logs[:, 0].sum())

    def close(self) -> None:
        """End the threads."""
        self._stop[0] = 1
        for thread in self._threads:
            thread.join(timeout=1.0)
