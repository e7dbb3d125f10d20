"""Clients that misbehave: links that are kept alive but not read, or slowly, silent connections.

python -m tests.rigs.hostile PORT KEY COUNT [BYTES]: COUNT subscribers that receive once and then
stop reading, or read so many bytes a second; it then prints "deaf".
"""

import socket
import sys
import threading
import time
from contextlib import ExitStack, suppress

from dehyst.daemon.bus.session import Bus

SMALL_BYTES = 4096
TURN_S = 0.1
"""A slow link reads once in this time [s]."""


class DeafLink:
    """A relay to the gateway that forwards what a client sends (its subscriptions, its keep-alives)
    and, once `deaf` is set, reads nothing of what the gateway answers, or few bytes a second."""

    def __init__(self, port: int, bytes_per_s: int = 0) -> None:
        self._port, self._bytes_per_s = port, bytes_per_s
        self.deaf = threading.Event()
        self._listener = socket.create_server(("127.0.0.1", 0))
        self.address = f"tcp/127.0.0.1:{self._listener.getsockname()[1]}"
        self._stack = ExitStack()
        self._stack.enter_context(self._listener)
        threading.Thread(target=self._serve, daemon=True).start()

    def _serve(self) -> None:
        try:
            near = self._stack.enter_context(self._listener.accept()[0])
        except OSError:
            return
        far = self._stack.enter_context(socket.socket())
        far.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, SMALL_BYTES)
        far.connect(("127.0.0.1", self._port))
        threading.Thread(target=self._answers, args=(far, near), daemon=True).start()
        with suppress(OSError):
            while data := near.recv(65536):
                far.sendall(data)

    def _answers(self, far: socket.socket, near: socket.socket) -> None:
        with suppress(OSError):
            while not self.deaf.is_set():
                data = far.recv(65536)
                if not data:
                    return
                near.sendall(data)
            while self._bytes_per_s and (data := far.recv(round(self._bytes_per_s * TURN_S))):
                near.sendall(data)
                time.sleep(TURN_S)


def idle_connections(port: int, count: int) -> ExitStack:
    """Open this many TCP connections that send nothing; they close with the returned stack."""
    stack = ExitStack()
    for _ in range(count):
        stack.enter_context(socket.create_connection(("127.0.0.1", port), timeout=10.0))
    return stack


def be_deaf(port: int, key: str, count: int, bytes_per_s: int = 0) -> None:
    """Run until killed."""
    links = [DeafLink(port, bytes_per_s) for _ in range(count)]
    heard = [threading.Event() for _ in links]
    buses = [Bus.connect([link.address]) for link in links]
    for bus, event in zip(buses, heard, strict=True):
        bus.listen(key, lambda _key, _payload, e=event: e.set())
    for event in heard:
        assert event.wait(60.0)
    for link in links:
        link.deaf.set()
    print("deaf", flush=True)
    threading.Event().wait()


if __name__ == "__main__":
    be_deaf(int(sys.argv[1]), sys.argv[2], *map(int, sys.argv[3:]))
