"""`dehyst page` as a real process, used as a browser would."""

import json
import os
import signal
import struct
import subprocess
import sys
import time
from collections.abc import Callable
from contextlib import ExitStack
from pathlib import Path
from typing import Any

import httpx
import numpy as np
from tests.rigs.gateway_bench import environment, free_port, wait_until
from websockets.sync.client import ClientConnection, connect

SIGNALS = 6


class PageProcess:
    """The page's server for one daemon. scheme: "https" if arguments give a certificate."""

    def __init__(self, address: str, *arguments: str, log: Path, scheme: str = "http") -> None:
        self.port, self.address, self.scheme = free_port(), address, scheme
        self.arguments, self.log = arguments, log
        self.host = f"127.0.0.1:{self.port}"
        self.url = f"{scheme}://{self.host}"
        self.http = httpx.Client(base_url=self.url, verify=False, timeout=20.0)
        self.start()

    def start(self) -> None:
        """Start the process and wait until it answers."""
        command = [sys.executable, "-P", "-m", "dehyst.daemon.main", "page", "--listen", self.host]
        with open(self.log, "ab") as words:
            self.process = subprocess.Popen(
                [*command, "--connect", self.address, *self.arguments],
                env=environment(), stdin=subprocess.DEVNULL, stdout=words, stderr=words,
            )  # fmt: skip
        wait_until("the page answers", self.answers)

    def answers(self) -> bool:
        """Return whether the page is served."""
        assert self.process.poll() is None, self.log.read_text()
        try:
            return self.http.get("/").status_code == 200
        except httpx.TransportError:
            return False

    def post(self, path: str, origin: str = "", **more: Any) -> httpx.Response:
        """Send a POST from the page itself, or from another origin."""
        return self.http.post(path, headers={"origin": origin or self.url}, **more)

    def kill(self, number: int = signal.SIGKILL) -> int:
        """Send a signal; return the exit code."""
        self.process.send_signal(number)
        return self.process.wait(20.0)

    def close(self) -> None:
        """End the process in order; it must not have ended before."""
        self.http.close()
        code = self.kill(signal.SIGTERM)
        assert code == 0, f"the page ended with {code}\n{self.log.read_text()}"

    def cpu_s(self) -> float:
        """Return the processor time that it has used."""
        fields = Path(f"/proc/{self.process.pid}/stat").read_text().rpartition(")")[2].split()
        return (int(fields[11]) + int(fields[12])) / os.sysconf("SC_CLK_TCK")


class Browser:
    """One WebSocket, as page.js uses it. said: newest message by kind; frames: of the plots."""

    def __init__(
        self, page: PageProcess, cookie: str = "", origin: str = "", source: str = "127.0.0.1"
    ) -> None:
        """source: the address of this machine from which it connects."""
        self._open = ExitStack()
        self.socket: ClientConnection = self._open.enter_context(
            connect(
                f"ws://{page.host}/stream",
                origin=origin or page.url,  # type: ignore[arg-type]
                additional_headers={"cookie": f"dehyst={cookie}"} if cookie else None,
                compression=None,
                source_address=(source, 0),
            )
        )
        self.said: dict[str, dict[str, Any]] = {}
        self.heard: list[dict[str, Any]] = []
        self.frames: list[Frame] = []

    def ask(self, what: str, **fields: Any) -> None:
        """Send one message."""
        self.socket.send(json.dumps({"ask": what, **fields}))

    def look(self, name: str = "bench", window_s: float = 10.0, width_px: int = 1000) -> None:
        """Select a controller to show."""
        self.ask("look", name=name, window_s=window_s, width_px=width_px)

    def until(self, what: str, check: Callable[[], Any], timeout_s: float = 60.0) -> Any:
        """Take messages until the check is true; return its value."""
        end = time.monotonic() + timeout_s
        while not (value := check()):
            left_s = end - time.monotonic()
            assert left_s > 0, f"not within {timeout_s:g} s: {what}; newest: {self.said}"
            self.take(left_s)
        return value

    def take(self, timeout_s: float) -> None:
        """Take one message."""
        try:
            message = self.socket.recv(timeout=min(timeout_s, 0.5))
        except TimeoutError:
            return
        if isinstance(message, bytes):
            self.frames.append(Frame(message))
        else:
            said = json.loads(message)
            self.heard.append(said)
            self.said[said["kind"]] = said

    def texts(self) -> list[str]:
        """Return the texts reported to this user."""
        return [said["text"] for said in self.heard if said["kind"] == "said"]

    def events(self) -> list[dict[str, Any]]:
        """Return all events so far."""
        return [e for said in self.heard if said["kind"] == "events" for e in said["events"]]

    def close(self) -> None:
        """Disconnect as a browser that goes away."""
        self._open.close()


class Frame:
    """One binary frame, decoded by the description in dehyst.daemon.page.wire."""

    def __init__(self, data: bytes) -> None:
        self.magic, n, anew, self.level, self.first_s, self.bucket_s, self.offset_s = (
            struct.unpack_from("<IIIIddd", data)
        )
        self.anew = bool(anew)
        self.offsets = np.frombuffer(data, "<i4", n, 40)
        values = np.frombuffer(data, "<f4", 2 * n * SIGNALS, 40 + 4 * n)
        self.least, self.largest = values.reshape(SIGNALS, 2, n).swapaxes(0, 1)
        assert len(data) == 40 + 4 * n * (1 + 2 * SIGNALS)
