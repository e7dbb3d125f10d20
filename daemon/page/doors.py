"""Limit the page server's connections in time and per address, so that connections left silent do
not affect other users. Extends uvicorn's protocols.

A connection is waiting while none of its requests is being answered: before its first request,
between two, and while the head of one arrives. It may wait for HEAD_S. If too many are waiting, the
one that has waited longest is closed, of the address that has the most.
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
"""Longest wait for the head of a request: a browser sends it at once; a slow link needs seconds."""
MOST_OF_ONE, MOST_WAITING = 64, 512
"""Most waiting connections per address and in total; a browser opens six."""
UNREAD_MS = 20_000
"""A client that accepts no data for this long counts as disconnected."""
BACKLOG = 1024  # connections that the kernel queues: twice MOST_WAITING


class Waiting:
    """Waiting connections by address, each in order of waiting time, longest first."""

    def __init__(self) -> None:
        self._of: dict[str, dict[Door, None]] = {}
        self._count = 0

    def add(self, door: "Door") -> None:
        """Add a connection that waits from now on; if there are too many, another is closed."""
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
        """Remove a connection that no longer waits."""
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
    """One HTTP connection."""

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
        """Start to wait for the first request."""
        super().connection_made(transport)
        self.address = origin_of(self.client[0] if self.client else "")
        self._wait()

    def data_received(self, data: bytes) -> None:
        """Handle the data, then wait unless a request is being answered."""
        super().data_received(data)
        self._look()

    def on_response_complete(self) -> None:
        """Wait again, unless the next request has already arrived."""
        super().on_response_complete()
        self._look()

    def connection_lost(self, exc: Exception | None) -> None:
        """Stop waiting: the connection has ended."""
        self._wait_no_longer()
        super().connection_lost(exc)

    def handle_websocket_upgrade(self, event: Any) -> None:
        """Stop waiting: the connection becomes a WebSocket, which has separate limits."""
        self._wait_no_longer()
        self._upgraded = True
        super().handle_websocket_upgrade(event)

    def send_400_response(self, msg: str) -> None:
        """Refuse data that are not HTTP; while a request is being answered, close the connection
        without a response."""
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
        """Abort when pings are not answered, without waiting for unsent data."""
        super().keepalive_timeout()
        self.transport.abort()


class Loop(asyncio.SelectorEventLoop):
    """Limits the time of the TLS handshake, which precedes the HTTP connection."""

    async def create_server(self, *given: Any, **more: Any) -> asyncio.Server:
        """Create the server as requested, with limits for TLS."""
        if isinstance(more.get("ssl"), ssl.SSLContext):
            more |= {"ssl_handshake_timeout": HEAD_S, "ssl_shutdown_timeout": 2.0}
        return await super().create_server(*given, **more)


def open_door(address: str) -> socket.socket:
    """Return a socket that listens at HOST:PORT. Raises BadInput if it cannot, for example because
    the port is in use."""
    host, _, port = address.rpartition(":")
    host = host.strip("[]")
    family = socket.AF_INET6 if ":" in host else socket.AF_INET
    try:
        door = socket.create_server((host, int(port)), family=family, backlog=BACKLOG)
    except OSError as error:
        raise BadInput(f"page.listen: {address}: {_words(error, port)}") from None
    # connections inherit both, see tcp(7); asyncio sets the second only for sockets it creates
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
