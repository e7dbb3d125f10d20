"""Whether core and gateway still move, seen from the rings: for the supervisor.

The core writes a sample a period and a status a second in every state; the gateway takes
telemetry every few milliseconds. A process that stands still for HANG_S while the one who looks
does not is hanging: stopped, deadlocked, or stuck in a system call.
"""

from pathlib import Path

from dehyst.daemon.records import TELEMETRY
from dehyst.daemon.ring import Ring
from dehyst.models.errors import BadInput

CORE_HANG_S, GATEWAY_HANG_S = 10.0, 20.0
LONGEST_LOOK_S = 1.0
"""More than this between two looks is not counted: then the machine stood still."""


class Pulse:
    """Looks at the telemetry ring in `directory`."""

    def __init__(self, directory: Path) -> None:
        self._path = directory / "telemetry.ring"
        self._ring: Ring | None = None
        self._looked_ns = 0
        self._head = self._tail = -1
        self._core_s = self._gateway_s = 0.0
        self.beats = False
        """True once samples were seen to be written."""

    def restart(self) -> None:
        """Forget what was seen: a process was started anew."""
        self._core_s = self._gateway_s = 0.0
        self._head = self._tail = -1
        self._ring = None

    def hanging(self, now_ns: int) -> tuple[bool, bool]:
        """(core hangs, gateway hangs); call it about twice a second."""
        passed_s = min((now_ns - self._looked_ns) * 1e-9, LONGEST_LOOK_S)
        self._looked_ns = now_ns
        ring = self._attached()
        if ring is None:
            return False, False
        head, tail = ring.head, ring.tail
        self.beats = self.beats or 0 <= self._head < head
        moved, taken = head != self._head, tail != self._tail or tail == head
        self._core_s = 0.0 if moved or head == 0 else self._core_s + passed_s
        self._gateway_s = 0.0 if taken or not moved else self._gateway_s + passed_s
        self._head, self._tail = head, tail
        core, gateway = self._core_s > CORE_HANG_S, self._gateway_s > GATEWAY_HANG_S
        if core:
            self._core_s = 0.0
        if gateway:
            self._gateway_s = 0.0
        return core, gateway

    def _attached(self) -> Ring | None:
        if self._ring is None or self._ring.stale():
            self.restart()
            try:
                self._ring = Ring.attach(self._path, TELEMETRY)
            except BadInput:
                return None
        return self._ring
