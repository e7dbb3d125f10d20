"""Passes commands from the clients to the command rings: they wait in bounded queues, are admitted
or refused (dehyst.daemon.gateway.admission), and are passed on by one thread for all axes.

Questions (commands with an answer: leases, stop, trajectory chunks) take precedence over set-points
that were put, so that a flood of set-points cannot delay a stop. Each axis has its own queue of
set-points, and the queues are served in turn, so that a flood at one axis delays no other.
"""

import logging
import threading
from collections import deque
from collections.abc import Mapping, Sequence
from queue import Empty, SimpleQueue
from typing import Any

import msgspec
from numpy.typing import NDArray

from dehyst.daemon import clock
from dehyst.daemon.bus import encoding
from dehyst.daemon.bus.keys import Keys
from dehyst.daemon.bus.messages import Chosen, Chunk, Rejection, Reply, Request, Setpoint
from dehyst.daemon.bus.session import Asked, Bus
from dehyst.daemon.bus.topics import REJECTION, subject
from dehyst.daemon.gateway.admission import Admission
from dehyst.daemon.gateway.core_rings import CoreRings
from dehyst.daemon.gateway.group_start import GroupStarts
from dehyst.daemon.gateway.together import handle_together

log = logging.getLogger(__name__)
WAITING_PUTS = 1024  # set-points; a further one displaces the oldest, and is counted
CROWD = 64
"""When more set-points than this wait, only the newest of each sender is considered."""
WAITING_QUESTIONS = 256  # commands that expect an answer; one more gets none
REJECTIONS_NS = 100_000_000  # between two messages about refused set-points
LONGEST_REFUSALS = 64  # senders and reasons in such a message


class AxisInbox:
    """Waiting set-points and refusals of one axis. keys, rings, admission: the axis's own."""

    def __init__(self, bus: Bus, keys: Keys, rings: CoreRings, admission: Admission) -> None:
        self.name, self.rings, self.admission = keys.name, rings, admission
        self.puts: deque[tuple[str, bytes]] = deque(maxlen=WAITING_PUTS)
        self.flooded = 0
        self._refusals: dict[tuple[int, str], tuple[int, str]] = {}
        self._published_ns = 0
        self._rejections = bus.sender(keys.pubsub(subject(REJECTION)), REJECTION)

    def refused(self, client: int, code: str, text: str, count: int) -> None:
        """Store a refusal until it is published."""
        key = (client, code)
        if key in self._refusals or len(self._refusals) < LONGEST_REFUSALS:
            self._refusals[key] = (self._refusals.get(key, (0, ""))[0] + count, text)
        if clock.monotonic_ns() - self._published_ns >= REJECTIONS_NS:
            self.publish_refusals()

    def publish_refusals(self) -> None:
        """Publish the refusals, at most ten times per second and once per client and code."""
        now_ns = clock.monotonic_ns()
        if now_ns - self._published_ns < REJECTIONS_NS:
            return
        if self.flooded:
            count, self.flooded = self.flooded, 0
            self.admission.rejected["flood"] += count
            self._refusals[(0, "flood")] = (count, "more commands than the daemon can process")
        if not self._refusals:
            return
        self._published_ns = now_ns
        refusals, self._refusals = self._refusals, {}
        for (client, code), (count, text) in refusals.items():
            message = Rejection(time_ns=now_ns, client=client, code=code, text=text, count=count)
            self._rejections.put(encoding.encode(message))


def _sender_of(key: str) -> int:
    """Return the client number at the end of a set-point's key; 0: it is none."""
    try:
        return msgspec.convert(key.rpartition("/")[2], Chosen, strict=False)
    except msgspec.ValidationError:
        return 0


class CommandIntake:
    """Takes commands for these axes. `run` is its thread; `put` and `ask` are called from zenoh's
    threads."""

    def __init__(self, inboxes: Sequence[AxisInbox]) -> None:
        self._inboxes = {inbox.name: inbox for inbox in inboxes}
        self._questions: SimpleQueue[tuple[AxisInbox, Asked]] = SimpleQueue()
        self._work = threading.Event()
        self._starts = GroupStarts(self._report)
        self._own: SimpleQueue[tuple[AxisInbox, NDArray[Any]]] = SimpleQueue()

    def put(self, inbox: AxisInbox, key: str, payload: bytes) -> None:
        """Queue a set-point. If too many wait, drop the oldest, as only the newest matters. Of a
        payload that is too long, only enough is kept to show that it is."""
        if len(inbox.puts) == WAITING_PUTS:
            inbox.flooded += 1
        inbox.puts.append((key, payload[: encoding.MAX_COMMAND_BYTES + 1]))
        self._work.set()

    def ask(self, inbox: AxisInbox, asked: Asked) -> None:
        """Queue a command that expects an answer. If too many wait, it gets none."""
        if asked.may_wait(self._questions.qsize(), WAITING_QUESTIONS):
            self._questions.put((inbox, asked))
            self._work.set()
        else:
            inbox.flooded += 1
            asked.done()

    def pass_to_loop(self, inbox: AxisInbox, records: NDArray[Any]) -> None:
        """Pass on (n,) COMMAND records issued by the gateway itself; from any thread."""
        self._own.put((inbox, records))
        self._work.set()

    def run(self, stop: threading.Event) -> None:
        """Pass commands on until `stop` is set."""
        while not stop.is_set():
            self._work.wait(0.1)
            self._work.clear()
            self._pass_own()
            while self._answer_one() or self._take_one_each():
                if stop.is_set():
                    return
            self._starts.drop_late(clock.monotonic_ns())
            for inbox in self._inboxes.values():
                inbox.publish_refusals()

    def _report(self, axis: str, text: str) -> None:
        self._inboxes[axis].admission.report(2, "trajectory", text)

    def _pass_own(self) -> None:
        """Pass on the gateway's own records; retry later for a loop whose ring is full."""
        for _ in range(self._own.qsize()):
            inbox, records = self._own.get()
            if inbox.rings.room > 0:
                inbox.rings.push(records)
            else:
                self._own.put((inbox, records))

    def _answer_one(self) -> bool:
        try:
            inbox, asked = self._questions.get_nowait()
        except Empty:
            return False
        asked.reply(encoding.encode(self._decide(inbox, asked.payload)))
        asked.done()
        return True

    def _take_one_each(self) -> bool:
        """Handle one waiting set-point per axis; return False if there is none."""
        taken = [self._take_one(inbox) for inbox in self._inboxes.values()]
        return any(taken)

    def _take_one(self, inbox: AxisInbox) -> bool:
        if len(inbox.puts) > CROWD:
            self._thin_out(inbox)
        try:
            key, payload = inbox.puts.popleft()
        except IndexError:
            return False
        self._decide(inbox, payload, _sender_of(key))
        return True

    def _thin_out(self, inbox: AxisInbox) -> None:
        """Handle only the newest waiting set-point of each sender and drop the rest."""
        waiting = [inbox.puts.popleft() for _ in range(len(inbox.puts))]
        newest = dict(waiting)
        inbox.flooded += len(waiting) - len(newest)
        for key, payload in newest.items():
            self._decide(inbox, payload, _sender_of(key))

    def _decide(self, inbox: AxisInbox, payload: bytes, put_by: int | None = None) -> Reply:
        """Decide a command. put_by: the client that put it, by its key; None: it was asked."""
        now_ns = clock.monotonic_ns()
        client = put_by or 0
        try:
            command = encoding.decode_command(payload)
            if put_by is not None and not isinstance(command, Setpoint):
                raise encoding.BadMessage(
                    "only set-points may be sent by put; send everything else as a query"
                )
        except encoding.BadMessage as error:
            reply = inbox.admission.refuse(now_ns, "bad-message", str(error))
        else:
            client = command.client
            try:
                if isinstance(command, Request) and command.axes:
                    reply = self._decide_together(now_ns, inbox, command)
                elif isinstance(command, Chunk) and (why := self._why_not_together(inbox, command)):
                    reply = inbox.admission.refuse(now_ns, "bad-message", why)
                elif isinstance(command, Chunk) and len(command.axes) > 1:
                    reply = self._decide_group(now_ns, inbox, command)
                else:
                    reply, records = inbox.admission.handle(now_ns, command, inbox.rings.room)
                    self._starts.withdraw({inbox.name: records})
                    inbox.rings.push(records)
            except Exception:  # one command must not bring the gateway down
                log.exception("a command could not be decided: %r", command)
                reply = inbox.admission.refuse(now_ns, "bad-message", "an error in the daemon")
        if not reply.ok:
            inbox.refused(client, reply.code, reply.text, 1)
        return reply

    def _why_not_together(self, inbox: AxisInbox, chunk: Chunk) -> str:
        """Return why these axes cannot play together, or "". A start would wait for an unknown
        axis."""
        axes = chunk.axes
        if not axes or (
            inbox.name in axes and set(axes) <= self._inboxes.keys() and len(set(axes)) == len(axes)
        ):
            return ""
        return f"axes {', '.join(axes)}: there are {', '.join(self._inboxes)}, each at most once"

    def _decide_group(self, now_ns: int, inbox: AxisInbox, chunk: Chunk) -> Reply:
        reply, records = self._starts.handle(now_ns, chunk, self._gates(), inbox.name)
        self._push(records)
        return reply

    def _decide_together(self, now_ns: int, inbox: AxisInbox, request: Request) -> Reply:
        reply, records = handle_together(now_ns, request, self._gates(), inbox.name)
        self._starts.withdraw(records)
        self._push(records)
        return reply

    def _gates(self) -> dict[str, tuple[Admission, int]]:
        return {name: (inbox.admission, inbox.rings.room) for name, inbox in self._inboxes.items()}

    def _push(self, records: Mapping[str, NDArray[Any]]) -> None:
        for name, of_axis in records.items():
            self._inboxes[name].rings.push(of_axis)
