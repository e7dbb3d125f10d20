"""The bus session; the only module that imports zenoh.

Everything is explicit: addresses to listen on (loopback unless configured), no multicast, no
gossip, no shared memory, bounded message sizes. Callbacks run in zenoh's own threads, where a slow
one blocks the whole session, so they may only store what they receive. A session that is not closed
hangs at the end of the program, so use a Bus in a `with` statement.
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
from dehyst.daemon.bus.encoding import (
    ENCODING,
    MAX_ANSWERED_BYTES,
    MAX_BATCH_BYTES,
    MAX_COMMAND_BYTES,
)
from dehyst.daemon.bus.security import check_address, check_open
from dehyst.daemon.bus.topics import Topic
from dehyst.daemon.bus.unread import end_unread_connections
from dehyst.daemon.closing import Closing
from dehyst.drivers import system
from dehyst.models.errors import DehystError

log = logging.getLogger(__name__)
LINK_BUFFER_BYTES = 1 << 18  # 256 KiB in the kernel for each link
MOST_UNKNOWN = 4096
"""Largest number of connections that have not identified themselves yet."""
UNREAD_MS = 3000
"""How long a subscriber may read nothing before its connection is closed."""
NOBODY_LISTENS = "Unable to connect to any of"
"""zenoh's message if no address answers; our own message says more."""
MOST_LONG = 8
"""Largest number of queries in a queue that are too long to be a command."""
CALLBACK_ENDS_S = 2.0
"""How long to wait for a callback's thread [s]. A callback only stores, so its thread ends within
milliseconds of its session, or within seconds on a machine without a free processor."""


class BusError(DehystError):
    """Nothing answers, an answer is late or refused, or a session cannot be opened."""


class Nobody(BusError):
    """No one is there to answer at present."""


class NoAnswer(BusError):
    """The other side is there but did not answer in time."""


class Asked:
    """A query that was sent to a queryable. Answer with `reply`, finish with `done`.

    key: the queryable's, under which it is answered, so that a query for several daemons shows
    whose answer each is; that of the query if the queryable itself serves several.
    """

    def __init__(self, query: "zenoh.Query", queryable: str) -> None:
        self._query = query
        self.key = str(query.key_expr) if "*" in queryable else queryable
        self.payload = query.payload.to_bytes() if query.payload is not None else b""

    def may_wait(self, waiting: int, most: int) -> bool:
        """Return whether it may be queued behind `waiting` others. most: largest number of
        queries in the queue; of those too long to be a command, a few, for their memory."""
        return waiting < (most if len(self.payload) <= MAX_COMMAND_BYTES else MOST_LONG)

    def reply(self, payload: bytes, encoding: str = ENCODING) -> None:
        """Send one answer; several are allowed. A client that has disconnected is not an error."""
        try:
            self._query.reply(self.key, payload, encoding=encoding)
        except zenoh.ZError as error:
            log.debug("answer to %s not sent: %s", self.key, error)

    def refuse(self, text: str) -> None:
        """Answer with an error and its reason."""
        try:
            self._query.reply_err(text[:500].encode(), encoding="text/plain")
        except zenoh.ZError as error:
            log.debug("refusal of %s not sent: %s", self.key, error)

    def done(self) -> None:
        """Finish the query: no more answers follow."""
        self._query.drop()


class Sender:
    """Publishes one topic under one key."""

    def __init__(self, publisher: "zenoh.Publisher", check: Callable[[], None]) -> None:
        self._publisher, self._check = publisher, check

    def put(self, payload: bytes) -> None:
        """Publish a payload. Raises BusError if the session is closed or belongs to another
        process."""
        self._check()
        try:
            self._publisher.put(payload)
        except zenoh.ZError as error:
            raise BusError(f"cannot publish: {error}") from None


class Bus(Closing):
    """A zenoh session. Create it with `serve` or `connect`, and use it in a `with` statement."""

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
        """Return False in a process that was forked from the one of this session."""
        return os.getpid() == self._process

    def check_process(self) -> None:
        """Raise BusError in a process that was forked from the one of this session."""
        if not self.is_of_this_process:
            raise BusError(
                "this connection was made before the process was forked and cannot be used here: "
                "make a new Client in the child"
            )

    def of_the_library(self) -> list[Any]:
        """Return the zenoh objects that this session holds."""
        return [self._opened, self._kept]

    @classmethod
    def serve(
        cls,
        listen: Sequence[str],
        connect: Sequence[str],
        security: Mapping[str, Any] | None = None,
    ) -> Self:
        """Open the daemon's session: it listens, and connects to routers if there are any.

        security: settings from dehyst.daemon.bus.security; None: loopback only.
        """
        check_open(listen, security is not None)
        settings = _common(MAX_ANSWERED_BYTES + 4096) | {
            "mode": "peer",
            "listen/endpoints": list(listen),
            "connect/endpoints": list(connect),
            "connect/timeout_ms": -1,  # keep trying to reach a router that is not up yet
            "connect/exit_on_failure": False,
            # one full link may delay all others by at most 1 ms, then it loses the batch
            "transport/link/tx/queue/congestion_control/drop/wait_before_drop": 1000,
            # a link that stays full for 2 s while an answer waits is closed
            "transport/link/tx/queue/congestion_control/block/wait_before_close": 2_000_000,
            # limits what the kernel buffers for a subscriber that does not read
            "transport/link/tcp/so_sndbuf": LINK_BUFFER_BYTES,
            "transport/link/tls/so_sndbuf": LINK_BUFFER_BYTES,
            # connections that have not identified themselves must not keep others out
            "transport/unicast/accept_pending": MOST_UNKNOWN,
            "transport/unicast/accept_timeout": 5000,  # ms
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
        """Open a client's session. Raises BusError if no address answers; later it reconnects.

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
            # only the querying thread waits for its own link, so a busy machine loses no query
            "transport/link/tx/queue/congestion_control/drop/wait_before_drop": 500_000,
        }
        where = ", ".join(addresses)
        return cls(
            settings,
            f"no daemon reached at {where}: is it running, is the address correct, and does it "
            "require credentials?",
        )

    def close(self) -> None:
        """Close the session. Safe to call twice; does nothing in a forked child."""
        if not self.is_of_this_process:
            return
        self._kept.clear()
        if not self._opened.is_closed():
            self._opened.close()
        for ended in wait(self._callback_threads, CALLBACK_ENDS_S).done:
            ended.result().join(CALLBACK_ENDS_S)

    def _callback(self, store: Callable[[Any], None]) -> Any:
        """Wrap `store` as a zenoh callback. Its thread is a daemon thread if the declaring thread
        is one, and would abort the program if it woke during interpreter shutdown; therefore
        `close` waits for it."""
        ended: Future[threading.Thread] = Future()
        for one in list(self._callback_threads):
            if one.done() and not one.result().is_alive():
                self._callback_threads.discard(one)
        self._callback_threads.add(ended)
        return zenoh.handlers.Callback(store, lambda: ended.set_result(threading.current_thread()))

    def watch_links(self) -> Callable[[], tuple[int, int]]:
        """Return a function that returns (open links, ended links)."""
        ended = itertools.count()
        newest = [0]

        def heard(event: zenoh.TransportEvent) -> None:
            if event.kind == zenoh.SampleKind.DELETE:
                newest[0] = next(ended) + 1

        listener = self._session.info.declare_transport_events_listener(self._callback(heard))
        self._kept.append(listener)
        return lambda: (len(self._session.info.transports()), newest[0])

    def sender(self, key: str, topic: Topic) -> Sender:
        """Return a publisher with the topic's quality of service."""
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
        """Subscribe to a key. `store(key, payload)` runs in zenoh's thread and must only store.
        Returns a function that ends the subscription."""

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
        callback = self._callback(lambda query: store(Asked(query, key)))
        self._kept.append(self._session.declare_queryable(key, callback, complete=True))

    def announce(self, key: str) -> None:
        """Declare a liveliness token, which disappears with this process."""
        self._kept.append(self._session.liveliness().declare_token(key))

    def alive(self, key: str, timeout_s: float = 1.0) -> list[str]:
        """Return the keys of the liveliness tokens that match."""
        replies = self._session.liveliness().get(key, timeout=timeout_s)
        return sorted({str(r.ok.key_expr) for r in replies if r.ok is not None})

    def ask(
        self, key: str, payload: bytes = b"", timeout_s: float = 3.0, long: bool = False
    ) -> Iterator[bytes]:
        """Yield the answers to a query as they arrive. Raises BusError if nothing answers.

        long: many or large answers are expected; the other side waits until we read them.
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
                # answers are sent with the query's quality of service
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
    """Return zenoh's congestion control for a topic's behaviour at a full link."""
    control = zenoh.CongestionControl
    # not BLOCK_FIRST: it holds one message for each link, and on a busy machine loses the second of
    # two that follow each other, such as a status and its event
    return {"drop": control.DROP, "wait": control.BLOCK}[what]


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
"""Batches that a link queues, by priority: for queries as many as one client's threads send at
once, for telemetry the backlog of a busy subscriber."""


def _common(longest: int) -> dict[str, Any]:
    return {
        "scouting/multicast/enabled": False,
        "scouting/gossip/enabled": False,
        "transport/shared_memory/enabled": False,
        "transport/link/rx/max_message_size": longest,
        "transport/link/tx/lease": 4000,  # a peer that hangs is dropped after 4 s
        "transport/link/tx/queue/size": _QUEUED,
    }
