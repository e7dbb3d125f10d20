"""The gateway's end of the rings: attach, attach again when the core was restarted, read, push."""

import os
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from dehyst.daemon.rings.layout import PID
from dehyst.daemon.rings.records import COMMAND, EVENT, TELEMETRY, LoopCommand
from dehyst.daemon.rings.ring import Ring
from dehyst.daemon.rings.status import STATUS
from dehyst.models.errors import BadInput

LAYOUTS = {"telemetry": TELEMETRY, "status": STATUS, "event": EVENT, "command": COMMAND}


class CoreRings:
    """The four rings of one core. Where there is none, reading gives nothing.

    The reader's place is kept in the rings themselves, so that a gateway that takes over from
    one that was killed goes on with the next sample.
    """

    def __init__(self, directory: Path) -> None:
        self.directory = directory
        self._rings: dict[str, Ring] = {}
        self._tails: dict[str, int] = {}

    @property
    def attached(self) -> bool:
        """True while rings are mapped."""
        return bool(self._rings)

    @property
    def run(self) -> int:
        """Number of the core's run, the same in all its rings; 0: none."""
        return self._rings["telemetry"].run if self._rings else 0

    @property
    def left_over(self) -> bool:
        """True where the process that made the rings has ended: they are of an earlier run, perhaps
        of another stage."""
        if not self._rings:
            return False
        try:
            os.kill(int(self._rings["event"].words[PID]), 0)
        except (ProcessLookupError, OverflowError):  # a damaged number is that of no process
            return True
        except OSError:  # it is another user's
            return False
        return False

    @property
    def damaged(self) -> int:
        """Records of this run that were dropped because they were damaged."""
        return sum(ring.damaged for ring in self._rings.values())

    def refresh(self) -> bool:
        """Attach where the core has made new rings; True when that happened."""
        # the core makes its command ring last: when that one is new, all are
        if self._rings and not self._rings["command"].stale():
            return False
        try:
            fresh = {
                name: Ring.attach(self.directory / f"{name}.ring", dtype)
                for name, dtype in LAYOUTS.items()
            }
        except BadInput:  # none yet, or of another version
            return False
        one_run = len({ring.run for ring in fresh.values()}) == 1
        if not one_run or any(ring.stale() for ring in fresh.values()):
            for ring in fresh.values():  # replaced while we attached
                ring.close()
            return False
        self._rings = fresh
        self._tails = {name: ring.tail for name, ring in fresh.items()}
        return True

    def read(self, name: str) -> tuple[NDArray[Any], int]:
        """(records not read before, number lost before them)."""
        ring = self._rings.get(name)
        if ring is None:
            return np.zeros(0, LAYOUTS[name]), 0
        if ring.head == self._tails[name]:  # mostly, for the rings of status and events
            return ring.records[:0], 0
        records, self._tails[name], lost = ring.read(self._tails[name])
        return records, lost

    def taken(self, name: str) -> None:
        """What was read has been passed on; a gateway after this one begins behind it."""
        if name in self._rings:
            self._rings[name].taken(self._tails[name])

    def before(self, name: str, count: int) -> NDArray[Any]:
        """Up to `count` records that were read already and are still there."""
        ring = self._rings.get(name)
        if ring is None:
            return np.zeros(0, LAYOUTS[name])
        tail = ring.head if name == "command" else self._tails[name]
        # a quarter of the ring is left alone: the writer is about to overwrite it
        start = max(0, tail - count, ring.head - 3 * ring.capacity // 4)
        return ring.read(start, max(0, tail - start))[0]

    def newest_status(self) -> NDArray[Any]:
        """(0,) or (1,): the core's last word on itself, read before or not."""
        ring = self._rings.get("status")
        if ring is None:
            return np.zeros(0, STATUS)
        return ring.read(max(0, ring.head - 1))[0][-1:]

    def newest_point(self) -> NDArray[Any]:
        """(0,) or (1,): the last command in the ring, where it is a trajectory point."""
        last = self.before("command", 1)
        return last[last["kind"] == LoopCommand.POINT]

    @property
    def room(self) -> int:
        """Commands that can be pushed now."""
        return self._rings["command"].free if self._rings else 0

    def push(self, commands: NDArray[Any]) -> None:
        """Pass commands on to the core; there must be room. One thread only."""
        if commands.size and self._rings:
            self._rings["command"].push_many(commands)
