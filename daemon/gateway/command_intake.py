"""From the clients to the command ring: what was sent waits in two bounded queues, is admitted or
refused (dehyst.daemon.gateway.admission), and passed on by one thread.

Questions (answered commands: leases, stop, trajectory chunks) go before set-points that were just
put, so that a flood of the latter cannot keep a stop away.
"""

import logging
import threading
from collections import deque
from queue import Empty, SimpleQueue
from typing import Any

from numpy.typing import NDArray

from dehyst.daemon import clock
from dehyst.daemon.bus import encoding
from dehyst.daemon.bus.keys import Keys
from dehyst.daemon.bus.messages import Rejection, Reply, Setpoint
from dehyst.daemon.bus.session import Asked, Bus
from dehyst.daemon.bus.topics import REJECTION, subject
from dehyst.daemon.gateway.admission import Admission
from dehyst.daemon.gateway.core_rings import CoreRings

log = logging.getLogger(__name__)
WAITING_PUTS = 1024
CROWD = 64
"""When more set-points than this wait, only the newest of each sender is looked at."""
WAITING_QUESTIONS = 256
REJECTIONS_NS = 100_000_000
LONGEST_REFUSALS = 64


class CommandIntake:
    """Takes commands. `run` is its thread; `put` and `ask` are called from zenoh's threads."""

    def __init__(self, bus: Bus, keys: Keys, rings: CoreRings, admission: Admission) -> None:
        self._rings, self._admission = rings, admission
        self._puts: deque[tuple[str, bytes]] = deque(maxlen=WAITING_PUTS)
        self._questions: SimpleQueue[Asked] = SimpleQueue()
        self._work = threading.Event()
        self._flooded = 0
        self._refusals: dict[tuple[int, str], tuple[int, str]] = {}
        self._told_ns = 0
        self._own: SimpleQueue[NDArray[Any]] = SimpleQueue()
        self._rejections = bus.sender(keys.pubsub(subject(REJECTION)), REJECTION)

    def put(self, key: str, payload: bytes) -> None:
        """Store a set-point. Where too many wait, the oldest goes: the newest is what counts."""
        if len(self._puts) == WAITING_PUTS:
            self._flooded += 1
        self._puts.append((key, payload))
        self._work.set()

    def ask(self, asked: Asked) -> None:
        """Store a command that wants an answer. Where too many wait, it gets none."""
        if self._questions.qsize() < WAITING_QUESTIONS:
            self._questions.put(asked)
            self._work.set()
        else:
            self._flooded += 1
            asked.done()

    def tell_loop(self, records: NDArray[Any]) -> None:
        """Pass on (n,) COMMAND records of the gateway's own; from any thread."""
        self._own.put(records)
        self._work.set()

    def run(self, stop: threading.Event) -> None:
        """Until `stop`."""
        while not stop.is_set():
            self._work.wait(0.1)
            self._work.clear()
            while not self._own.empty() and self._rings.room > 0:
                self._rings.push(self._own.get())
            while self._answer_one() or self._take_one():
                if stop.is_set():
                    return
            self._tell()

    def _answer_one(self) -> bool:
        try:
            asked = self._questions.get_nowait()
        except Empty:
            return False
        asked.reply(encoding.encode(self._decide(asked.payload)))
        asked.done()
        return True

    def _take_one(self) -> bool:
        if len(self._puts) > CROWD:
            self._thin_out()
        try:
            _, payload = self._puts.popleft()
        except IndexError:
            return False
        self._decide(payload, only_setpoints=True)
        return True

    def _thin_out(self) -> None:
        """Of what waits, keep the newest of each sender."""
        waiting = [self._puts.popleft() for _ in range(len(self._puts))]
        newest = dict(waiting)
        self._flooded += len(waiting) - len(newest)
        for payload in newest.values():
            self._decide(payload, only_setpoints=True)

    def _decide(self, payload: bytes, only_setpoints: bool = False) -> Reply:
        now_ns = clock.monotonic_ns()
        client = 0
        try:
            command = encoding.decode_command(payload)
            if only_setpoints and not isinstance(command, Setpoint):
                raise encoding.BadMessage("only set-points may be put; ask for everything else")
        except encoding.BadMessage as error:
            reply = self._admission.refuse(now_ns, "bad-message", str(error))
        else:
            client = command.client
            try:
                reply, records = self._admission.handle(now_ns, command, self._rings.room)
                self._rings.push(records)
            except Exception:  # one command must not take the gateway from everybody
                log.exception("a command could not be decided: %r", command)
                reply = self._admission.refuse(now_ns, "bad-message", "an error in the daemon")
        if not reply.ok:
            self._refused(client, reply.code, reply.text, 1)
        return reply

    def _refused(self, client: int, code: str, text: str, count: int) -> None:
        key = (client, code)
        if key in self._refusals or len(self._refusals) < LONGEST_REFUSALS:
            self._refusals[key] = (self._refusals.get(key, (0, ""))[0] + count, text)
        if clock.monotonic_ns() - self._told_ns >= REJECTIONS_NS:
            self._tell()

    def _tell(self) -> None:
        """Publish the refusals, at most ten times a second and once for each client and reason."""
        now_ns = clock.monotonic_ns()
        if now_ns - self._told_ns < REJECTIONS_NS:
            return
        if self._flooded:
            count, self._flooded = self._flooded, 0
            self._admission.rejected["flood"] += count
            self._refusals[(0, "flood")] = (count, "more commands than the daemon reads")
        if not self._refusals:
            return
        self._told_ns = now_ns
        refusals, self._refusals = self._refusals, {}
        for (client, code), (count, text) in refusals.items():
            message = Rejection(time_ns=now_ns, client=client, code=code, text=text, count=count)
            self._rejections.put(encoding.encode(message))
