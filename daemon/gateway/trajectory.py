"""Follows a trajectory as its chunks arrive: new points, their order, and how much is ahead."""

from collections import deque
from dataclasses import dataclass
from typing import NamedTuple, TypeAlias

import numpy as np
from numpy.typing import NDArray

from dehyst.daemon.bus import encoding
from dehyst.daemon.bus.messages import Chunk
from dehyst.daemon.bus.refusal_codes import NotAdmitted
from dehyst.daemon.gateway.core_view import CoreView
from dehyst.daemon.rings.records import LATEST_OFFSET_NS, State

Offsets: TypeAlias = NDArray[np.int64]
Values: TypeAlias = NDArray[np.float64]
COMPLETE = "it is complete"
CLOSEST = 0.7
"""Least mean distance of a chunk's points, in periods of the loop: a client at the loop's rate may
round its times, and its clock may be fast. The loop's queue has room for points this close."""


class NewPoints(NamedTuple):
    """New points, (n,) each: times from the trajectory's start [ns], targets, corrections."""

    offsets: Offsets
    values: Values
    learned: Values


@dataclass
class TrajectoryProgress:
    """The trajectory being played, as far as it was passed on."""

    number: int = 0
    client: int = 0
    next_index: int = -1  # -1: unknown, as this gateway started during the trajectory
    end_ns: int = -1  # offset of the newest point passed on
    over: str = ""  # why no further points are accepted
    refused: bool = False  # a final refusal was reported

    @classmethod
    def resumed(cls, newest: NDArray[np.void]) -> "TrajectoryProgress":
        """Return the progress made by an earlier gateway. newest: (0,) or (1,) POINT records."""
        if not newest.size:
            return cls()
        point = newest[-1]
        return cls(
            number=int(point["trajectory"]),
            client=int(point["client"]),
            end_ns=int(point["offset_ns"]),
            over=COMPLETE if point["last"] else "",
        )

    def is_of(self, command: Chunk) -> bool:
        """Return whether the chunk belongs to this trajectory."""
        return (self.number, self.client) == (command.trajectory, command.client)

    def continued(self, command: Chunk) -> "TrajectoryProgress":
        """Return the chunk's trajectory; a new one if chunk 0 starts it. Raises NotAdmitted."""
        if self.is_of(command):
            return self
        if command.index == 0:
            return TrajectoryProgress(command.trajectory, command.client, 0)
        raise NotAdmitted(
            "over", f"trajectory {command.trajectory} is not the one being played; begin at chunk 0"
        )

    def new_points(self, command: Chunk) -> NewPoints | None:
        """Return the points of a chunk that were not passed on yet; None: all were. Raises
        NotAdmitted if the trajectory is over, or the chunk or its times are out of order."""
        offsets, values = encoding.points(command)
        learned = encoding.corrections(command)
        passed_on = 0 <= command.index < self.next_index
        if passed_on and self.over in ("", COMPLETE):
            return None
        if self.over:
            raise NotAdmitted("over", f"trajectory {command.trajectory}: {self.over}")
        if self.next_index >= 0 and command.index != self.next_index:
            raise NotAdmitted(
                "order", f"chunk {command.index} arrived, but chunk {self.next_index} is next"
            )
        if np.any(offsets[1:] <= offsets[:-1]):
            raise NotAdmitted("order", "the times of a chunk must strictly increase")
        if offsets[0] < 0 or offsets[-1] > LATEST_OFFSET_NS:
            wrong = offsets[0] if offsets[0] < 0 else offsets[-1]
            raise NotAdmitted(
                "offset",
                f"a point lies {1e-9 * float(wrong):g} s after the trajectory's start; a point has "
                f"0 to {1e-9 * LATEST_OFFSET_NS:g} s (a year)",
            )
        if self.next_index < 0:  # do not send points twice that an earlier gateway passed on
            fresh = offsets > self.end_ns
            offsets, values, learned = offsets[fresh], values[fresh], learned[fresh]
            if not offsets.size:
                self.next_index = command.index + 1
                return None
        elif self.end_ns >= 0 and offsets[0] <= self.end_ns:
            raise NotAdmitted("order", "the chunk begins before the end of the previous one")
        return NewPoints(offsets, values, learned)

    def span_ns(self, offsets: Offsets) -> int:
        """Return by how much these points extend the trajectory [ns]."""
        return int(offsets[-1]) - (self.end_ns if self.end_ns >= 0 else int(offsets[0]))

    def check_dense(self, offsets: Offsets, period_ns: int) -> None:
        """Raise NotAdmitted if the points are spaced more closely than the loop's period."""
        span_ns, gaps = self.span_ns(offsets), offsets.size - (self.end_ns < 0)
        if span_ns < CLOSEST * gaps * period_ns:
            raise NotAdmitted(
                "dense",
                f"the points are {span_ns / max(gaps, 1) * 1e-6:.3g} ms apart, but the loop's "
                f"period is {period_ns * 1e-6:.3g} ms; send at most {1e9 / period_ns:g} points a "
                "second",
            )

    def pass_on(self, command: Chunk, offsets: Offsets) -> None:
        """Record that these points of the chunk go to the loop."""
        self.next_index, self.end_ns = command.index + 1, int(offsets[-1])
        self.over = COMPLETE if command.last else ""


class PassedOn:
    """Tracks how much trajectory is ahead of the loop. most_s: how much is accepted [s]."""

    def __init__(self, most_s: float) -> None:
        self.most_s = most_s
        self._passed: deque[tuple[int, float]] = deque()  # (when, seconds of trajectory)

    def clear(self) -> None:
        """Forget what was passed on, as it is withdrawn."""
        self._passed.clear()

    def add(self, now_ns: int, span_s: float) -> None:
        """Record that `span_s` of trajectory was passed on now."""
        self._passed.append((now_ns, span_s))

    def ahead_s(self, now_ns: int, core: CoreView) -> float:
        """Return an upper limit [s]: the loop's last report plus what was passed on since."""
        while self._passed and self._passed[0][0] < core.status_ns - 2 * core.period_ns:
            self._passed.popleft()
        drained = (now_ns - core.status_ns) * 1e-9 if core.state is State.RUNNING else 0.0
        return max(0.0, core.queue_s - drained) + sum(s for _, s in self._passed)

    def check_room(self, ahead_s: float, span_s: float) -> None:
        """Raise NotAdmitted if a chunk of this length is too long or too early."""
        if span_s > self.most_s:
            raise NotAdmitted(
                "span",
                f"the chunk spans {span_s:.3g} s; at most {self.most_s:g} s are accepted in one: "
                "send it in parts, with points in between",
            )
        if ahead_s + span_s > self.most_s:
            raise NotAdmitted(
                "queue-full",
                f"{ahead_s:.2f} s are queued already, at most {self.most_s:g} s are accepted; "
                "send this chunk later",
            )
