"""The connections of the page's server: bounded in time and for each address, so that what somebody
opens and leaves silent costs nobody else anything. uvicorn's protocols, with what they lack.

A connection waits while no request of it is being answered: before its first request, between two,
and while the head of one comes. It waits HEAD_S at most. Where too many wait, the one that has
waited longest is ended, of the address that has most of them.
"""

import asyncio
import errno
import socket
import ssl
from typing import Any

from uvicorn.protocols.http.h11_impl import H11Protocol
from uvicorn.protocols.websockets.websockets_sansio_impl import WebSocketsSansIOProtocol

from dehyst.daemon.page.guesses import origin_of
from dehyst.drivers import system
from dehyst.models.errors import BadInput

HEAD_S = 10.0
"""A browser sends the head of a request at once; a slow link needs seconds."""
MOST_OF_ONE, MOST_WAITING = 64, 512
"""Waiting connections of one address, of all; a browser opens six."""
UNREAD_MS = 20_000
"""Who takes nothing for this long is gone."""
BACKLOG = 1024


class Waiting:
    """Connections that wait, by address, the one that has waited longest first."""

    def __init__(self) -> None:
        self._of: dict[str, dict[Door, None]] = {}
        self._count = 0

    def add(self, door: "Door") -> None:
        """This one waits from now on; another one may be ended for it."""
        mine = self._of.setdefault(door.address, {})
        if door in mine:
            return
        mine[door] = None
        self._count += 1
        if len(mine) > MOST_OF_ONE:
            self._end(mine)
        elif self._count > MOST_WAITING:
            self._end(max(self._of.values(), key=len))

    def remove(self, door: "Door") -> None:
        """It waits no longer."""
        mine = self._of.get(door.address, {})
        if door in mine:
            del mine[door]
            self._count -= 1
            if not mine:
                del self._of[door.address]

    def _end(self, doors: "dict[Door, None]") -> None:
        oldest = next(iter(doors))
        self.remove(oldest)
        oldest.transport.abort()


class Door(H11Protocol):
    """One connection of HTTP."""

    def __init__(self, *given: Any, **more: Any) -> None:
        super().__init__(*given, **more)
        state = self.server_state
        if not hasattr(state, "waiting"):
            state.waiting = Waiting()  # type: ignore[attr-defined]
        self._waiting: Waiting = state.waiting  # type: ignore[attr-defined]
        self._late: asyncio.TimerHandle | None = None
        self._upgraded = False
        self.address = ""

    def connection_made(self, transport: asyncio.Transport) -> None:  # type: ignore[override]
        """It waits."""
        super().connection_made(transport)
        self.address = origin_of(self.client[0] if self.client else "")
        self._wait()

    def data_received(self, data: bytes) -> None:
        """Whether it still waits is seen from whether a request is being answered."""
        super().data_received(data)
        self._look()

    def on_response_complete(self) -> None:
        """It waits again, unless a next request came with this one."""
        super().on_response_complete()
        self._look()

    def connection_lost(self, exc: Exception | None) -> None:
        """It has gone."""
        self._wait_no_longer()
        super().connection_lost(exc)

    def handle_websocket_upgrade(self, event: Any) -> None:
        """It is a WebSocket from now on, which has limits of its own."""
        self._wait_no_longer()
        self._upgraded = True
        super().handle_websocket_upgrade(event)

    def send_400_response(self, msg: str) -> None:
        """What is no HTTP ends the connection; within a request there is nobody to answer."""
        if self.cycle is not None and not self.cycle.response_complete:
            self.transport.abort()
            return
        super().send_400_response(msg)

    def _look(self) -> None:
        if self._upgraded or self.transport.is_closing():
            return
        if self.cycle is not None and not self.cycle.response_complete:
            self._wait_no_longer()
        else:
            self._wait()

    def _wait(self) -> None:
        if self._late is None:
            self._late = self.loop.call_later(HEAD_S, self.transport.abort)
        self._waiting.add(self)

    def _wait_no_longer(self) -> None:
        self._waiting.remove(self)
        if self._late is not None:
            self._late.cancel()
            self._late = None


class Wire(WebSocketsSansIOProtocol):
    """One WebSocket."""

    def keepalive_timeout(self) -> None:
        """Its other side answers no ping: what it has not taken is not waited for."""
        super().keepalive_timeout()
        self.transport.abort()


class Loop(asyncio.SelectorEventLoop):
    """Bounds the handshake of TLS, which comes before there is a connection of HTTP."""

    async def create_server(self, *given: Any, **more: Any) -> asyncio.Server:
        """As asked for."""
        if isinstance(more.get("ssl"), ssl.SSLContext):
            more |= {"ssl_handshake_timeout": HEAD_S, "ssl_shutdown_timeout": 2.0}
        return await super().create_server(*given, **more)


def open_door(address: str) -> socket.socket:
    """A socket that listens at HOST:PORT. BadInput where it cannot: the port is busy, say."""
    host, _, port = address.rpartition(":")
    host = host.strip("[]")
    family = socket.AF_INET6 if ":" in host else socket.AF_INET
    try:
        door = socket.create_server((host, int(port)), family=family, backlog=BACKLOG)
    except OSError as error:
        raise BadInput(f"page.listen: {address}: {_words(error, port)}") from None
    # connections inherit both, see tcp(7); asyncio sets the second for sockets of its own alone
    system.end_unread(door, UNREAD_MS)
    door.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
    return door


def _words(error: OSError, port: str) -> str:
    if error.errno == errno.EADDRINUSE:
        return (
            f"another program listens on port {port} already (`ss -ltnp sport = :{port}` names "
            "it); end it, or serve the page on another port"
        )
    if error.errno == errno.EACCES:
        return f"port {port} requires root; use one above 1023"
    if isinstance(error, socket.gaierror):
        return "this machine knows no such host"
    if error.errno == errno.EADDRNOTAVAIL:
        return "this machine has no such address"
    return error.strerror or str(error)
