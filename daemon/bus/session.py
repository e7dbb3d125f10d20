"""The bus: the one place that imports zenoh.

Everything is explicit: addresses to listen on (loopback unless configured), no multicast, no
gossip, no shared memory, bounded message sizes. Callbacks run in zenoh's own threads, where a slow
one blocks the whole session: they may only store what they got. A session that is not closed
hangs at the end of the program, so a Bus is used with `with`.
"""

import itertools
import json
import logging
import os
import threading
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from concurrent.futures import Future, wait
from typing import Any, Self

import zenoh

from dehyst.daemon.bus import after_fork
from dehyst.daemon.bus.encoding import ENCODING, MAX_BATCH_BYTES, MAX_COMMAND_BYTES
from dehyst.daemon.bus.security import check_address, check_open
from dehyst.daemon.bus.sockets import end_unread_connections
from dehyst.daemon.bus.topics import Topic
from dehyst.daemon.closing import Closing
from dehyst.drivers import system
from dehyst.models.errors import DehystError

log = logging.getLogger(__name__)
LINK_BUFFER_BYTES = 1 << 18
MOST_UNKNOWN = 4096
"""Connections whose first word is still to come."""
UNREAD_MS = 3000
"""So long a subscriber may take nothing before its connection ends."""
NOBODY_LISTENS = "Unable to connect to any of"
"""zenoh's words where no address answers: ours say more."""
CALLBACK_ENDS_S = 2.0
"""A callback only stores, so its thread ends within milliseconds of its session, or of seconds on a
machine without a free processor."""


class BusError(DehystError):
    """Nobody there, no answer, or a session that cannot be opened."""


class Nobody(BusError):
    """Nobody is there to answer, at present."""


class NoAnswer(BusError):
    """Somebody is there but did not answer in time."""


class Asked:
    """A question that was put to a queryable. Answer with `reply`, end with `done`."""

    def __init__(self, query: "zenoh.Query") -> None:
        self._query = query
        self.key = str(query.key_expr)
        self.payload = query.payload.to_bytes() if query.payload is not None else b""

    def reply(self, payload: bytes, encoding: str = ENCODING) -> None:
        """Send one answer; there may be several. An asker who is gone is no error."""
        try:
            self._query.reply(self.key, payload, encoding=encoding)
        except zenoh.ZError as error:
            log.debug("answer to %s not sent: %s", self.key, error)

    def refuse(self, text: str) -> None:
        """Answer that there is no answer, and why."""
        try:
            self._query.reply_err(text[:500].encode(), encoding="text/plain")
        except zenoh.ZError as error:
            log.debug("refusal of %s not sent: %s", self.key, error)

    def done(self) -> None:
        """No more answers."""
        self._query.drop()


class Sender:
    """Publishes one topic under one key."""

    def __init__(self, publisher: "zenoh.Publisher", check: Callable[[], None]) -> None:
        self._publisher, self._check = publisher, check

    def put(self, payload: bytes) -> None:
        """Publish. Raises BusError when the session is closed, or of another process."""
        self._check()
        try:
            self._publisher.put(payload)
        except zenoh.ZError as error:
            raise BusError(f"cannot publish: {error}") from None


class Bus(Closing):
    """A zenoh session. Make one with `serve` or `connect`; use it with `with`."""

    def __init__(self, settings: dict[str, Any], what: str) -> None:
        global zenoh
        zenoh = after_fork.usable_library(zenoh)
        config = zenoh.Config()
        try:
            for key, value in settings.items():
                config.insert_json5(key, json.dumps(value))
        except zenoh.ZError as error:
            reason = str(error).split(" at /")[0].rpartition('msg: "')[2]
            raise BusError(f"an address of the bus is invalid: {reason}") from None
        try:
            self._opened = zenoh.open(config)
        except zenoh.ZError as error:
            reason = str(error).split(" at /")[0]
            more = "" if reason.startswith(NOBODY_LISTENS) else f" ({reason})"
            raise BusError(f"{what}{more}") from None
        self._kept: list[Any] = []
        self._callback_threads: set[Future[threading.Thread]] = set()
        self._process = os.getpid()
        after_fork.keep_from_children(self)

    @property
    def _session(self) -> "zenoh.Session":
        self.check_process()
        return self._opened

    @property
    def is_of_this_process(self) -> bool:
        """False in a process that was forked from the one of this session."""
        return os.getpid() == self._process

    def check_process(self) -> None:
        """Raises BusError in a process that was forked from the one of this session."""
        if not self.is_of_this_process:
            raise BusError(
                "this connection was made before the process was forked and cannot be used here: "
                "make a new Client in the child"
            )

    def of_the_library(self) -> list[Any]:
        """The objects of zenoh that it holds."""
        return [self._opened, self._kept]

    @classmethod
    def serve(
        cls,
        listen: Sequence[str],
        connect: Sequence[str],
        security: Mapping[str, Any] | None = None,
    ) -> Self:
        """The daemon's session: listens, and connects to routers where there are any.

        security: settings from dehyst.daemon.bus.security; None: loopback only.
        """
        check_open(listen, security is not None)
        settings = _common(MAX_COMMAND_BYTES + 4096) | {
            "mode": "peer",
            "listen/endpoints": list(listen),
            "connect/endpoints": list(connect),
            "connect/timeout_ms": -1,  # a router that is not up yet is no reason to give up
            "connect/exit_on_failure": False,
            # how long one full link may hold up all the others: 1 ms, then it loses the batch
            "transport/link/tx/queue/congestion_control/drop/wait_before_drop": 1000,
            # one that stays full so long is closed
            "transport/link/tx/queue/congestion_control/block/wait_before_close": 2_000_000,
            # what a subscriber that does not read can make the kernel keep for it
            "transport/link/tcp/so_sndbuf": LINK_BUFFER_BYTES,
            "transport/link/tls/so_sndbuf": LINK_BUFFER_BYTES,
            # connections that have not said who they are keep nobody else out
            "transport/unicast/accept_pending": MOST_UNKNOWN,
            "transport/unicast/accept_timeout": 5000,
        }
        system.allow_open_files()
        where = ", ".join(listen)
        settings |= dict(security or {})
        bus = cls(
            settings,
            f"cannot listen on {where}: another daemon uses it, or it is not an address of this "
            "machine",
        )
        end_unread_connections(UNREAD_MS)
        return bus

    @classmethod
    def connect(
        cls,
        addresses: Sequence[str],
        timeout_s: float = 3.0,
        security: Mapping[str, Any] | None = None,
    ) -> Self:
        """A client's session. Raises BusError where nobody listens; afterwards it reconnects.

        security: credentials from dehyst.daemon.bus.security.client_settings.
        """
        for address in addresses:
            check_address(address, "the daemon's address")
        settings = _common(MAX_BATCH_BYTES) | dict(security or {})
        settings |= {
            "mode": "client",
            "connect/endpoints": list(addresses),
            "connect/timeout_ms": round(1e3 * timeout_s),
            "connect/exit_on_failure": True,
            "connect/retry": {
                "period_init_ms": 200,
                "period_max_ms": 1000,
                "period_increase_factor": 2,
            },
            # only the thread that asks waits for its own link, so a busy machine loses no question
            "transport/link/tx/queue/congestion_control/drop/wait_before_drop": 500_000,
        }
        where = ", ".join(addresses)
        return cls(
            settings,
            f"no daemon reached at {where}: is it running, is the address correct, and does it "
            "require credentials?",
        )

    def close(self) -> None:
        """End the session. Safe to call twice; in a forked child it does nothing."""
        if not self.is_of_this_process:
            return
        self._kept.clear()
        if not self._opened.is_closed():
            self._opened.close()
        for ended in wait(self._callback_threads, CALLBACK_ENDS_S).done:
            ended.result().join(CALLBACK_ENDS_S)

    def _callback(self, store: Callable[[Any], None]) -> Any:
        """`store`, as zenoh takes it. Its thread, a daemon where the one that declares is, aborts
        the program where it wakes at the interpreter's end: `close` waits for it."""
        ended: Future[threading.Thread] = Future()
        for one in list(self._callback_threads):
            if one.done() and not one.result().is_alive():
                self._callback_threads.discard(one)
        self._callback_threads.add(ended)
        return zenoh.handlers.Callback(store, lambda: ended.set_result(threading.current_thread()))

    def watch_links(self) -> Callable[[], tuple[int, int]]:
        """A function that says (links that are open, links that have ended)."""
        ended = itertools.count()
        newest = [0]

        def heard(event: zenoh.TransportEvent) -> None:
            if event.kind == zenoh.SampleKind.DELETE:
                newest[0] = next(ended) + 1

        listener = self._session.info.declare_transport_events_listener(self._callback(heard))
        self._kept.append(listener)
        return lambda: (len(self._session.info.transports()), newest[0])

    def sender(self, key: str, topic: Topic) -> Sender:
        """A publisher with the topic's quality of service."""
        publisher = self._session.declare_publisher(
            key,
            encoding=ENCODING,
            congestion_control=_full(topic.full),
            priority=getattr(zenoh.Priority, topic.priority),
            express=topic.express,
            reliability=zenoh.Reliability.RELIABLE,
        )
        self._kept.append(publisher)
        return Sender(publisher, self.check_process)

    def listen(self, key: str, store: Callable[[str, bytes], None]) -> Callable[[], None]:
        """Subscribe. `store(key, payload)` runs in zenoh's thread and must only store. Returns a
        function that ends it."""

        def received(sample: zenoh.Sample) -> None:
            store(str(sample.key_expr), sample.payload.to_bytes())

        subscriber = self._session.declare_subscriber(key, self._callback(received))
        self._kept.append(subscriber)

        def end() -> None:
            if self.is_of_this_process and subscriber in self._kept:
                self._kept.remove(subscriber)
                subscriber.undeclare()

        return end

    def answer(self, key: str, store: Callable[[Asked], None]) -> None:
        """Serve a queryable. `store(asked)` runs in zenoh's thread and must only store."""
        callback = self._callback(lambda query: store(Asked(query)))
        self._kept.append(self._session.declare_queryable(key, callback, complete=True))

    def announce(self, key: str) -> None:
        """Declare a liveliness token: gone when this process is."""
        self._kept.append(self._session.liveliness().declare_token(key))

    def alive(self, key: str, timeout_s: float = 1.0) -> list[str]:
        """Keys of the liveliness tokens that match."""
        replies = self._session.liveliness().get(key, timeout=timeout_s)
        return sorted({str(r.ok.key_expr) for r in replies if r.ok is not None})

    def ask(
        self, key: str, payload: bytes = b"", timeout_s: float = 3.0, long: bool = False
    ) -> Iterator[bytes]:
        """The answers to a question, as they come. Raises BusError where nobody answers.

        long: many or large answers are expected; the answerer waits for us to take them.
        """
        try:
            replies: Iterable[zenoh.Reply] = self._session.get(
                key,
                payload=payload,
                encoding=ENCODING,
                timeout=timeout_s,
                target=zenoh.QueryTarget.ALL,
                consolidation=zenoh.ConsolidationMode.NONE,
                priority=zenoh.Priority.DATA_LOW if long else zenoh.Priority.INTERACTIVE_HIGH,
                # the answers travel with the question's quality of service
                congestion_control=zenoh.CongestionControl.BLOCK
                if long
                else zenoh.CongestionControl.DROP,
                express=not long,
            )
        except zenoh.ZError as error:
            raise BusError(f"{key}: cannot be asked: {error}") from None
        answered = False
        for reply in replies:
            if reply.ok is None:
                text = reply.err.payload.to_bytes() if reply.err is not None else b""
                if text != b"Timeout":
                    raise BusError(f"{key}: refused: {text.decode('utf-8', 'replace')}")
                raise NoAnswer(
                    f"{key}: no answer within {timeout_s:g} s; the daemon may hang, or may not "
                    "accept these credentials"
                )
            answered = True
            yield reply.ok.payload.to_bytes()
        if not answered:
            raise Nobody(
                f"{key}: nobody answers; the daemon has ended, or does not accept these credentials"
            )


def _full(what: str) -> "zenoh.CongestionControl":
    """What happens to a topic's message where the link is full."""
    control = zenoh.CongestionControl
    return {"drop": control.DROP, "wait": control.BLOCK, "close": control.BLOCK_FIRST}[what]


_QUEUED = {
    "control": 2,
    "real_time": 2,
    "interactive_high": 16,
    "interactive_low": 2,
    "data_high": 16,
    "data": 16,
    "data_low": 2,
    "background": 2,
}
"""Batches that a link holds back, by priority: of questions as many as one client's threads put at
once, of telemetry what a busy subscriber is behind."""


def _common(longest: int) -> dict[str, Any]:
    return {
        "scouting/multicast/enabled": False,
        "scouting/gossip/enabled": False,
        "transport/shared_memory/enabled": False,
        "transport/link/rx/max_message_size": longest,
        "transport/link/tx/lease": 4000,  # a peer that hangs is given up after 4 s
        "transport/link/tx/queue/size": _QUEUED,
    }
