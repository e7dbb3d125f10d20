"""Measure how busy this machine is with other work: whether a real-time test can be judged, and how
much longer its waits take. Reads /proc; without it, the machine counts as quiet."""

import os
from collections.abc import Callable, Iterable
from dataclasses import dataclass, replace
from pathlib import Path

from dehyst.daemon import clock

SO_IT_WAS, IT_WAS_NOT, TOO_BUSY = 0, 1, 77
"""Exit statuses of a real-time test. Test suites treat 77 as skipped."""
MOST_LATE = 0.02
"""With a larger share of late samples, the machine determines the tracking error, not the model."""
MOST_OTHERS = 0.25
"""Largest share of all processors used by other work: above it, a process at the lowest priority no
longer has a processor to itself."""
MOST_STOLEN = 0.05
"""Largest share of time taken by a hypervisor: at 200 Hz this makes one sample in twenty late."""
MOST_LOAD = 1.5
"""Largest number of processes per processor: above it, each waits for others a third of its
time."""
MOST_STRETCH = 6.0
"""Longest wait, as a multiple of the wait on a quiet machine."""
SAY_S, MEASURE_S = 20.0, 2.0
"""SAY_S: longest wait without a message; MEASURE_S: interval over which the load is measured."""


@dataclass(frozen=True)
class Busy:
    """others, stolen: shares of processor time (0 to 1) taken by other work and by a hypervisor;
    late: share of samples that missed their deadline; load: processes per processor."""

    others: float = 0.0
    stolen: float = 0.0
    load: float = 0.0
    late: float = 0.0

    @property
    def why(self) -> str:
        """Reason why nothing can be judged on this machine now; "" if it can."""
        said = []
        if self.late > MOST_LATE:
            said.append(f"{100 * self.late:.0f} % of the samples missed their deadline")
        if self.others > MOST_OTHERS:
            said.append(f"other processes used {100 * self.others:.0f} % of its processors")
        if self.stolen > MOST_STOLEN:
            said.append(f"its hypervisor took {100 * self.stolen:.0f} % of its time")
        if self.load > MOST_LOAD:
            said.append(f"{self.load:.1f} processes waited for each processor")
        return ", ".join(said)

    @property
    def stretch(self) -> float:
        """Factor by which a wait may be longer than on a quiet machine, 1 to MOST_STRETCH; late
        samples alone do not increase it."""
        if not replace(self, late=0.0).why:
            return 1.0
        left = max(1.0 - self.others - self.stolen, 1e-9)
        return min(MOST_STRETCH, max(self.load, 1.0 / left))


@dataclass(frozen=True)
class ProcessorTicks:
    """Ticks of all processors since start-up: total, idle, stolen, own (this process and all its
    descendants); at_s: time of reading."""

    at_s: float
    total: int
    idle: int
    stolen: int
    own: int


def read_spent(proc: Path = Path("/proc")) -> ProcessorTicks:
    """Read the processor ticks since the machine started."""
    try:
        first = (proc / "stat").read_text().partition("\n")[0]
    except OSError:
        return ProcessorTicks(clock.monotonic_ns() * 1e-9, 0, 0, 0, 0)
    ticks = [int(word) for word in first.split()[1:9]]
    own = _time_of_family(os.getpid(), _processes(proc))
    return ProcessorTicks(
        clock.monotonic_ns() * 1e-9, sum(ticks), ticks[3] + ticks[4], ticks[7], own
    )


def busy_between(first: ProcessorTicks, last: ProcessorTicks, late: float = 0.0) -> Busy:
    """Return how busy the machine was between two readings. late: share of late samples."""
    total = last.total - first.total
    if total <= 0:
        return Busy(late=late)
    stolen = (last.stolen - first.stolen) / total
    working = 1.0 - (last.idle - first.idle) / total - stolen
    own = max(0, last.own - first.own) / total
    return Busy(max(0.0, working - own), stolen, _load(), late)


def _load() -> float:
    """Return the running and waiting processes, averaged over the last minute, per processor of
    this process."""
    return os.getloadavg()[0] / len(os.sched_getaffinity(0))


def _processes(proc: Path) -> Iterable[tuple[int, int, int]]:
    """Yield (process, its parent, ticks used by it and its ended children)."""
    for path in proc.iterdir():
        if not path.name.isdigit():
            continue
        try:
            words = (path / "stat").read_text().rpartition(")")[2].split()
        except OSError:
            continue  # it has just ended
        yield int(path.name), int(words[1]), sum(int(word) for word in words[11:15])


def _time_of_family(top: int, processes: Iterable[tuple[int, int, int]]) -> int:
    """Return the ticks of a process and all its descendants."""
    known = {pid: (parent, ticks) for pid, parent, ticks in processes}
    total = 0
    for pid, (_, ticks) in known.items():
        one, seen = pid, set()
        while one != top and one in known and one not in seen:
            seen.add(one)
            one = known[one][0]
        total += ticks if one == top else 0
    return total


class Patience:
    """Time limit of a wait: `seconds` on a quiet machine, longer on a busy one. say: receives a
    line now and then, with what it `waits` for."""

    def __init__(self, seconds: float, waits: str, say: Callable[[str], None]) -> None:
        self._left_s, self._waits, self._say = seconds, waits, say
        self.spent_s = self._said_s = 0.0
        self._seen_ns, self._measured = clock.monotonic_ns(), read_spent()
        self._busy = Busy()

    @property
    def over(self) -> bool:
        """Whether the time limit has passed."""
        return self._left_s <= 0.0

    def look(self) -> None:
        """Account for the time since the last call, and for how busy the machine was."""
        now_ns = clock.monotonic_ns()
        passed_s, self._seen_ns = (now_ns - self._seen_ns) / clock.NS, now_ns
        if now_ns / clock.NS - self._measured.at_s >= MEASURE_S:
            now = read_spent()
            self._busy, self._measured = busy_between(self._measured, now), now
        self.pass_by(passed_s, self._busy)

    def pass_by(self, seconds: float, busy: Busy) -> None:
        """Account for `seconds` on a machine that was this busy."""
        self.spent_s += seconds
        self._left_s -= seconds / busy.stretch
        if self.spent_s - self._said_s >= SAY_S:
            self._said_s = self.spent_s
            more = f"; this machine is busy: {busy.why}" if busy.why else ""
            self._say(f"   waiting {self._waits}, {self.spent_s:.0f} s now{more}")
