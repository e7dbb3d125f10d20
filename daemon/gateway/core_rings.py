"""The gateway's end of the rings: attach, reattach after a restart of the core, read, push."""

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
NOT_RUNNING = "ZXTt"
"""States of proc(5): a zombie, dead, stopped by a signal or by a debugger."""


def has_ended(pid: int) -> bool:
    """Return True if there is no such process."""
    try:
        os.kill(pid, 0)
    except (ProcessLookupError, OverflowError):  # a damaged number belongs to no process
        return True
    except OSError:  # the process belongs to another user
        return False
    return False


def is_suspended(pid: int) -> bool:
    """Return True if this process exists and does not run: it is stopped, or a zombie."""
    try:
        words = Path(f"/proc/{pid}/stat").read_text("utf-8", "replace")
    except OSError:  # it may be hidden
        return False
    return words.rpartition(")")[2].split()[0] in NOT_RUNNING


class CoreRings:
    """The four rings of one core. Without a core, reads return nothing.

    The read position is stored in the rings themselves, so that a gateway that replaces a killed
    one continues with the next sample.
    """

    def __init__(self, directory: Path) -> None:
        self.directory = directory
        self._rings: dict[str, Ring] = {}
        self._tails: dict[str, int] = {}

    @property
    def is_attached(self) -> bool:
        """Return True while rings are mapped."""
        return bool(self._rings)

    @property
    def run(self) -> int:
        """Return the number of the core's run, the same in all its rings; 0: none."""
        return self._rings["telemetry"].run if self._rings else 0

    @property
    def is_left_over(self) -> bool:
        """Return True if the process that made the rings has ended: they belong to an earlier run,
        perhaps of another stage."""
        if not self._rings:
            return False
        return has_ended(int(self._rings["event"].words[PID]))

    @property
    def is_stopped(self) -> bool:
        """Return True if the process that made the rings has ended or is suspended."""
        if not self._rings:
            return False
        pid = int(self._rings["event"].words[PID])
        return has_ended(pid) or is_suspended(pid)

    @property
    def damaged(self) -> int:
        """Return how many records of this run were dropped because they were damaged."""
        return sum(ring.damaged for ring in self._rings.values())

    def refresh(self) -> bool:
        """Attach if the core has made new rings; return True if it attached."""
        # the core makes its command ring last: if that one is new, all are
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
        """Return (records not read before, number of records lost before them)."""
        ring = self._rings.get(name)
        if ring is None:
            return np.zeros(0, LAYOUTS[name]), 0
        if ring.head == self._tails[name]:  # the usual case for the status and event rings
            return ring.records[:0], 0
        records, self._tails[name], lost = ring.read(self._tails[name])
        return records, lost

    def mark_taken(self, name: str) -> None:
        """Mark what was read as passed on; a later gateway continues after it."""
        if name in self._rings:
            self._rings[name].taken(self._tails[name])

    def read_again(self, name: str, count: int) -> NDArray[Any]:
        """Return up to `count` records that were read already and are still there."""
        ring = self._rings.get(name)
        if ring is None:
            return np.zeros(0, LAYOUTS[name])
        tail = ring.head if name == "command" else self._tails[name]
        # skip the oldest quarter of the ring, which the writer is about to overwrite
        start = max(0, tail - count, ring.head - 3 * ring.capacity // 4)
        return ring.read(start, max(0, tail - start))[0]

    def newest_status(self) -> NDArray[Any]:
        """Return the (0,) or (1,) newest status record of the core, read before or not."""
        ring = self._rings.get("status")
        if ring is None:
            return np.zeros(0, STATUS)
        return ring.read(max(0, ring.head - 1))[0][-1:]

    def newest_point(self) -> NDArray[Any]:
        """Return the last command in the ring (1,) if it is a trajectory point, else (0,)."""
        last = self.read_again("command", 1)
        return last[last["kind"] == LoopCommand.POINT]

    @property
    def room(self) -> int:
        """Return how many commands can be pushed now."""
        return self._rings["command"].free if self._rings else 0

    def push(self, commands: NDArray[Any]) -> None:
        """Push commands to the core; there must be room. Call from one thread only."""
        if commands.size and self._rings:
            self._rings["command"].push_many(commands)
