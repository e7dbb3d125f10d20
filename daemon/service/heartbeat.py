"""Detect from the rings whether core and gateway are alive, for the supervisor.

In every state the core writes one sample per period, and the gateway takes telemetry every few
milliseconds. A process that makes no progress for its time limit while the supervisor itself runs
is hanging: stopped, deadlocked, or stuck in a system call. Only the rings of the process that was
started count. A process without any progress yet is still starting and gets START_S, because its
kernels may have to be compiled first.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from dehyst.daemon.rings.records import TELEMETRY
from dehyst.daemon.rings.ring_file import RingFile
from dehyst.models.errors import BadInput

# so long without progress is a hang, not a slow device; compiling takes one to three minutes
CORE_HANG_S, GATEWAY_HANG_S, START_S = 10.0, 20.0, 300.0
LONGEST_LOOK_S = 1.0
"""Longest time counted between two looks; if more has passed, the machine itself stalled."""


@dataclass
class _Watched:
    """One process. moves: it has made progress since its start; still_s: time since the last
    progress [s]; limit_s: time without progress after which it hangs [s]."""

    limit_s: float
    moves: bool = False
    still_s: float = 0.0

    def look(self, moved: bool, passed_s: float) -> None:
        self.moves = self.moves or moved
        self.still_s = 0.0 if moved else self.still_s + passed_s

    @property
    def hangs(self) -> bool:
        return self.still_s > (self.limit_s if self.moves else START_S)


class Heartbeat:
    """Watches the telemetry ring in `directory`. Call core_started and gateway_started whenever
    one of the processes is started."""

    def __init__(
        self,
        directory: Path,
        core_hang_s: float = CORE_HANG_S,
        gateway_hang_s: float = GATEWAY_HANG_S,
    ) -> None:
        self._path = directory / "telemetry.ring"
        self._ring: RingFile | None = None
        self._limits_s = core_hang_s, gateway_hang_s
        self._looked_ns = 0
        self.core_started(0)
        self.gateway_started()

    def core_started(self, pid: int) -> None:
        """Note that the core is this process now; records of other processes do not count."""
        self._pid, self._head = pid, 0
        self.core = _Watched(self._limits_s[0])

    def gateway_started(self) -> None:
        """Note that the gateway was started again."""
        self.gateway, self._tail = _Watched(self._limits_s[1]), -1

    def look(self, now_ns: int) -> None:
        """Check both processes for progress; call it a few times a second."""
        passed_s = min((now_ns - self._looked_ns) * 1e-9, LONGEST_LOOK_S)
        self._looked_ns = now_ns
        head, tail = self._place()
        wrote = head != self._head
        self.core.look(wrote, passed_s)
        took = self._tail >= 0 and tail != self._tail
        # the gateway need not make progress while there is nothing to take
        self.gateway.look(took, passed_s if wrote and tail != head else 0.0)
        self._head, self._tail = head, tail

    def _place(self) -> tuple[int, int]:
        """Return (head, tail) of the core's own ring; the last known ones if it has none (yet)."""
        try:
            if self._ring is None or self._ring.stale():
                if self._ring is not None:
                    self._ring.close()
                self._ring = None
                self._ring = RingFile(self._path, TELEMETRY)
                self._head = 0
            if self._ring.pid != self._pid:
                return self._head, self._tail
            return self._ring.place()
        except BadInput:  # none yet, or a damaged one
            return self._head, self._tail


class Heartbeats:
    """Watches one core that writes the rings of all axes and one gateway that reads them all. A
    process moves if it does so on every axis, and hangs if it does so on any. directories: the
    axes' ring folders."""

    def __init__(self, directories: Sequence[Path]) -> None:
        self._axes = [Heartbeat(directory) for directory in directories]

    def core_started(self, pid: int) -> None:
        """Note that the core is this process now."""
        for axis in self._axes:
            axis.core_started(pid)

    def gateway_started(self) -> None:
        """Note that the gateway was started again."""
        for axis in self._axes:
            axis.gateway_started()

    def look(self, now_ns: int) -> None:
        """Check all axes for progress; call it a few times a second."""
        for axis in self._axes:
            axis.look(now_ns)

    @property
    def core_moves(self) -> bool:
        """True if the core has written a sample of every axis since its start."""
        return all(axis.core.moves for axis in self._axes)

    @property
    def core_hangs(self) -> bool:
        """True if the core has written no sample of some axis for too long."""
        return any(axis.core.hangs for axis in self._axes)

    @property
    def gateway_moves(self) -> bool:
        """True if the gateway has taken samples of every axis since its start."""
        return all(axis.gateway.moves for axis in self._axes)

    @property
    def gateway_hangs(self) -> bool:
        """True if the gateway has left the samples of some axis in the ring for too long."""
        return any(axis.gateway.hangs for axis in self._axes)
