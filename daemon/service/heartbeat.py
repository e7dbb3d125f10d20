"""Whether core and gateway still move, seen from the rings: for the supervisor.

The core writes a sample a period in every state; the gateway takes telemetry every few
milliseconds. A process that stands still for so long while the one who looks does not is hanging:
stopped, deadlocked, or stuck in a system call. Only rings of the very process that was started
count, and a process that has not begun to move yet is starting, which takes as long as kernels
take to be compiled.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from dehyst.daemon.rings.records import TELEMETRY
from dehyst.daemon.rings.ring_file import RingFile
from dehyst.models.errors import BadInput

CORE_HANG_S, GATEWAY_HANG_S, START_S = 10.0, 20.0, 300.0
LONGEST_LOOK_S = 1.0
"""More than this between two looks is not counted: then the machine stood still."""


@dataclass
class _Watched:
    """moves: it has moved since it was started; still_s: time since it last did."""

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
    """Looks at the telemetry ring in `directory`; say which processes were started."""

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
        """The core is this process now; what others wrote does not count."""
        self._pid, self._head = pid, 0
        self.core = _Watched(self._limits_s[0])

    def gateway_started(self) -> None:
        """The gateway was started anew."""
        self.gateway, self._tail = _Watched(self._limits_s[1]), -1

    def look(self, now_ns: int) -> None:
        """Judge both anew; about twice a second."""
        passed_s = min((now_ns - self._looked_ns) * 1e-9, LONGEST_LOOK_S)
        self._looked_ns = now_ns
        head, tail = self._place()
        wrote = head != self._head
        self.core.look(wrote, passed_s)
        took = self._tail >= 0 and tail != self._tail
        # it may stand still where there is nothing to take
        self.gateway.look(took, passed_s if wrote and tail != head else 0.0)
        self._head, self._tail = head, tail

    def _place(self) -> tuple[int, int]:
        """(head, tail) of the core's own ring; (0, 0) where it has none (yet)."""
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
    """One core that writes the rings of all axes, one gateway that takes them all: each moves when
    it does at every axis, and hangs when it does at one. directories: of the rings."""

    def __init__(self, directories: Sequence[Path]) -> None:
        self._axes = [Heartbeat(directory) for directory in directories]

    def core_started(self, pid: int) -> None:
        """The core is this process now."""
        for axis in self._axes:
            axis.core_started(pid)

    def gateway_started(self) -> None:
        """The gateway was started anew."""
        for axis in self._axes:
            axis.gateway_started()

    def look(self, now_ns: int) -> None:
        """Judge all anew; about twice a second."""
        for axis in self._axes:
            axis.look(now_ns)

    @property
    def core_moves(self) -> bool:
        """It has written a sample of every axis since it was started."""
        return all(axis.core.moves for axis in self._axes)

    @property
    def core_hangs(self) -> bool:
        """It has written nothing of one axis for too long."""
        return any(axis.core.hangs for axis in self._axes)

    @property
    def gateway_moves(self) -> bool:
        """It has taken samples of every axis since it was started."""
        return all(axis.gateway.moves for axis in self._axes)

    @property
    def gateway_hangs(self) -> bool:
        """It has not taken what there is of one axis for too long."""
        return any(axis.gateway.hangs for axis in self._axes)
