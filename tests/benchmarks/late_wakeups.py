"""A witness of the machine: on each CPU a process that only wakes every 5 ms, above all
other processes, and counts how often it is late, as cyclictest does. It shares nothing with what is
measured: when it is late, the machine was unavailable (its host took it, or an interrupt), and no
program on it was on time."""

import mmap
import os
import struct
import subprocess
import sys
import time
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Self

PERIOD_NS, LATE_NS = 5_000_000, 1_000_000
PRIORITY = 98  # above every loop, every loop's own witness, and every emulated device
LATE_SHARE = 0.005  # share of periods; with more, hardly any pass of 200 periods is on time
COUNTS = struct.Struct("qq")  # periods, and those with a late wake-up


class LateWakeups:
    """The witness, for the duration of a `with` block."""

    def __enter__(self) -> Self:
        self._folder = TemporaryDirectory()
        self._counts: list[Path] = []
        self.processes: list[subprocess.Popen[bytes]] = []
        self.refused = ""
        for cpu in sorted(os.sched_getaffinity(0)):
            path = Path(self._folder.name) / str(cpu)
            path.write_bytes(bytes(COUNTS.size))
            self._counts.append(path)
            process = subprocess.Popen([sys.executable, __file__, str(path), str(cpu)])
            self.processes.append(process)
            try:
                os.sched_setscheduler(process.pid, os.SCHED_FIFO, os.sched_param(PRIORITY))
            except OSError as error:
                self.refused = f"no witness: {error}"  # other programs would delay it
        return self

    def __exit__(self, *_: object) -> None:
        for process in self.processes:
            process.kill()
            process.wait()
        self._folder.cleanup()

    @property
    def share(self) -> float:
        """Late wake-ups so far, as a share of the periods, on the CPU with most of them; NaN if the
        witness has no data."""
        if self.refused:
            return float("nan")
        seen = [COUNTS.unpack(path.read_bytes()) for path in self._counts]
        return float(max(late / max(1, periods) for periods, late in seen))


def was_away(share: float, most: float = LATE_SHARE) -> str:
    """Return why times measured with this share of late wake-ups of the witness say nothing about a
    program; "" if they do."""
    if not share > most:
        return ""
    return (
        f"the machine was away: a process that only wakes every 5 ms was over 1 ms late in "
        f"{100 * share:.2g} % of its periods (most {100 * most:g} %)"
    )


def count(path: Path, cpu: int) -> None:
    """Wake and count until killed. Each period missed by oversleeping counts as late."""
    os.sched_setaffinity(0, {cpu})
    parent = os.getppid()
    with path.open("r+b") as file, mmap.mmap(file.fileno(), COUNTS.size) as counts:
        periods = late = 0
        due_ns = time.monotonic_ns()
        while os.getppid() == parent:
            due_ns += PERIOD_NS
            time.sleep(max(0, due_ns - time.monotonic_ns()) * 1e-9)
            away_ns = time.monotonic_ns() - due_ns
            passed = away_ns // PERIOD_NS
            periods, due_ns = periods + 1 + passed, due_ns + passed * PERIOD_NS
            if away_ns >= LATE_NS:
                late += 1 + passed
            counts[:] = COUNTS.pack(periods, late)


if __name__ == "__main__":
    count(Path(sys.argv[1]), int(sys.argv[2]))
