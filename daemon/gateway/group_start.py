"""Starts a trajectory of several axes on all of them, or on none.

The first chunks arrive axis by axis. Each is checked on arrival and kept; none reaches a loop until
those of all axes have arrived and passed a second check together. If one is refused, arrives too
late, names other axes, or another command arrives first, all are dropped; every axis reports the
reason, and clients that send more of that trajectory get it as well. Pure, like
dehyst.daemon.gateway.admission, which it uses: takes times as arguments and returns records.
"""

from collections import OrderedDict
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Any

from numpy.typing import NDArray

from dehyst.daemon.bus.messages import Chunk, Reply
from dehyst.daemon.bus.refusal_codes import NotAdmitted
from dehyst.daemon.gateway.admission import Admission

WAIT_NS = 2_000_000_000
"""How long the first chunk of an axis waits for those of the others; a client sends them one after
the other."""
MOST_STARTS = 16
"""How many pending trajectories are remembered; older ones that have not started are forgotten."""
Records = NDArray[Any]
Gates = Mapping[str, tuple[Admission, int]]


@dataclass
class _Start:
    """One pending trajectory. since_ns: when its first chunk arrived; axes: its axes, as that chunk
    names them; why: why it was dropped."""

    since_ns: int
    axes: tuple[str, ...]
    chunks: dict[str, Chunk] = field(default_factory=dict)
    why: str = ""


class GroupStarts:
    """Pending starts of trajectories of several axes. report: reports a text on an axis."""

    def __init__(self, report: Callable[[str, str], None] = lambda axis, text: None) -> None:
        self._report = report
        self._starts: OrderedDict[tuple[int, int], _Start] = OrderedDict()

    def handle(
        self, now_ns: int, chunk: Chunk, gates: Gates, asked: str
    ) -> tuple[Reply, dict[str, Records]]:
        """Return (answer, COMMAND records by axis). gates: each axis's admission and the room in
        its ring, by axis name; asked: the axis to whose key the chunk was sent."""
        gate, room = gates[asked]
        if gate.is_playing(chunk):
            reply, of_axis = gate.handle(now_ns, chunk, room)
            return reply, {asked: of_axis}
        try:
            return self._begin(now_ns, chunk, gates, asked)
        except NotAdmitted as no:
            return gate.refuse(now_ns, no.code, str(no)), {}

    def withdraw(self, records: Mapping[str, Records]) -> None:
        """Drop every pending start on an axis whose loop gets other records, such as a stop."""
        for name, of_axis in records.items():
            for start in self._starts.values():
                if of_axis.size and name in start.chunks:
                    self._drop(start, f"{name}: another command arrived before it started")

    def drop_late(self, now_ns: int) -> None:
        """Drop every start for which an axis has waited too long for the others."""
        for start in self._starts.values():
            if start.chunks and now_ns - start.since_ns > WAIT_NS:
                late = ", ".join(name for name in start.axes if name not in start.chunks)
                seconds = 1e-9 * WAIT_NS
                self._drop(start, f"the first points of {late} did not arrive within {seconds:g} s")

    def _begin(
        self, now_ns: int, chunk: Chunk, gates: Gates, asked: str
    ) -> tuple[Reply, dict[str, Records]]:
        gate, room = gates[asked]
        self.drop_late(now_ns)
        start = self._start_of(now_ns, chunk)
        if not start.why and set(chunk.axes) != set(start.axes):
            self._drop(
                start,
                f"{asked}: its points are for {', '.join(chunk.axes)} together, those before for "
                f"{', '.join(start.axes)}",
            )
        if start.why:
            raise NotAdmitted("over", f"{start.why}; no axis has started")
        if chunk.index > 0 and asked in start.chunks:
            raise NotAdmitted("queue-full", "the other axes have not started yet; send this later")
        try:
            gate.check_first(now_ns, chunk, room)
        except NotAdmitted as no:
            self._drop(start, f"{asked}: {no}")
            raise NotAdmitted(no.code, f"{no}; no axis has started") from None
        gate.lease.renew(now_ns, chunk.sent_ns)
        start.chunks[asked] = chunk
        if any(n not in start.chunks and not gates[n][0].is_playing(chunk) for n in chunk.axes):
            return gate.granted(now_ns, chunk), {}
        return self._pass_on(now_ns, start, gates, asked)

    def _pass_on(
        self, now_ns: int, start: _Start, gates: Gates, asked: str
    ) -> tuple[Reply, dict[str, Records]]:
        """Check the first chunks of all axes once more, and start all axes if all pass."""
        for name, chunk in start.chunks.items():
            gate, room = gates[name]
            try:
                gate.check_first(now_ns, chunk, room)
            except NotAdmitted as no:
                self._drop(start, f"{name}: {no}")
                raise NotAdmitted(no.code, f"{start.why}; no axis has started") from None
        replies, records = {}, {}
        for name, chunk in start.chunks.items():
            gate, room = gates[name]
            replies[name], records[name] = gate.handle(now_ns, chunk, room)
        self._starts = OrderedDict((k, v) for k, v in self._starts.items() if v is not start)
        self.withdraw(records)
        return replies[asked], records

    def _start_of(self, now_ns: int, chunk: Chunk) -> _Start:
        key = (chunk.client, chunk.trajectory)
        if key not in self._starts:
            self._starts[key] = _Start(now_ns, chunk.axes)
            while len(self._starts) > MOST_STARTS:
                self._starts.popitem(last=False)
        return self._starts[key]

    def _drop(self, start: _Start, why: str) -> None:
        start.why = why
        start.chunks.clear()
        for axis in start.axes:
            self._report(axis, f"{why}; no axis has started")
