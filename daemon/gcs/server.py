"""The TCP server: one thread per connection, limited number of connections and line length."""

import logging
import socket
import socketserver
import threading

from dehyst.daemon.gcs.controller import GcsController, GcsSession
from dehyst.daemon.gcs.dialect import answer_command
from dehyst.daemon.gcs.grammar import Splitter

log = logging.getLogger(__name__)
MOST_CONNECTIONS = 8
"""Enough for one program and a few others that only observe."""
PIECE = 1 << 16  # bytes that one read returns at most
KEEPALIVE = {"TCP_KEEPIDLE": 5, "TCP_KEEPINTVL": 2, "TCP_KEEPCNT": 3}
"""Silence [s] before the first probe, interval of the probes [s] and their number: a computer that
vanished silently is noticed after 11 s; the kernel alone would take two hours."""


class GcsServer(socketserver.ThreadingTCPServer):
    """Serves `controller` at (host, port). Raises OSError if the port is in use."""

    allow_reuse_address = True
    daemon_threads = True

    def __init__(self, address: tuple[str, int], controller: GcsController) -> None:
        if ":" in address[0]:
            self.address_family = socket.AF_INET6
        super().__init__(address, _Handler)
        self.controller = controller
        self._places = threading.BoundedSemaphore(MOST_CONNECTIONS)

    def verify_request(self, request: object, client_address: object) -> bool:
        """Accept the connection, or refuse it if too many are open."""
        if self._places.acquire(blocking=False):
            return True
        log.warning("refused %s: %d connections are open", client_address, MOST_CONNECTIONS)
        return False

    def give_back(self) -> None:
        """Free the place of a connection that has ended."""
        self._places.release()


class _Handler(socketserver.BaseRequestHandler):
    server: GcsServer

    def handle(self) -> None:
        connection: socket.socket = self.request
        connection.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        connection.setsockopt(socket.SOL_SOCKET, socket.SO_KEEPALIVE, 1)
        for name, value in KEEPALIVE.items():
            if (option := getattr(socket, name, None)) is not None:
                connection.setsockopt(socket.IPPROTO_TCP, option, value)
        controller, session, splitter = self.server.controller, GcsSession(), Splitter()
        log.info("%s connects", self.client_address)
        try:
            while data := connection.recv(PIECE):
                for command in splitter.feed(data):
                    if text := answer_command(controller, session, command):
                        connection.sendall(text.encode("cp1252", "replace"))
        except OSError as error:
            log.info("%s: %s", self.client_address, error)
        finally:
            controller.leave(session)
            log.info("%s has gone", self.client_address)

    def finish(self) -> None:
        self.server.give_back()
