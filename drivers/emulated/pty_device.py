"""A pseudo-terminal that looks like a serial port, connected to an emulated unit (Linux).

The unit is pure: bytes in, bytes out, an injected clock. Only this module handles file descriptors:

    server = PtyServer(unit, "/tmp/dehyst/mdt693b")     # the link is what a driver opens
    with server:                                        # a thread; or serve([server, other], stop)
        ...
        server.unplug(); server.plug()                  # pull the cable, put it back
        server.stall_writes(True)                       # the host's writes block, then time out
        server.call(lambda: unit.do_something())        # in the server's thread, race-free

It handles these pitfalls, all of which occur in practice:
- a fresh slave has ECHO, ICANON, ICRNL and ONLCR on: it is made raw before a client can open it;
- the master reads EIO once every slave is closed: the server keeps one slave open;
- replies that a client never reads fill the buffer: the master never blocks, bytes wait in order.
"""

import contextlib
import os
import select
import termios
import threading
import time
import tty
from collections.abc import Callable, Sequence
from concurrent.futures import Future
from pathlib import Path
from queue import SimpleQueue
from typing import Any, Protocol, Self, TypeVar

from msgspec import structs

T = TypeVar("T")

LONGEST_SLEEP_S = 0.5
"""The loop checks its stop flag at least this often."""


class PtyUnit(Protocol):
    """An emulated instrument on a serial line. Times are those of the unit's own clock, which must
    be the clock of the server (by default time.monotonic). faults: a Struct, replaced at run
    time."""

    faults: Any

    def feed(self, data: bytes) -> None:
        """Take bytes from the host that arrive now."""
        ...

    def take(self) -> bytes:
        """Return the next bytes that are due by now, as one write; b"" if none are due."""
        ...

    def next_due_s(self) -> float | None:
        """Return the clock time at which take() next has something; None if it waits for feed()."""
        ...

    def link_lost(self) -> None:
        """Handle a pulled cable: half-received commands and unsent replies are lost. The outputs
        stay as they are."""
        ...

    def set_serial_number(self, number: int) -> None:
        """Report the serial number of a different unit at the same port."""
        ...


class PtyServer:
    """One unit on one pty, reachable at a symbolic link.

    link_path: where the link to the slave is made (replaced if it is already a link; its folder
    must exist). Methods may be called from any thread.
    """

    def __init__(
        self, unit: PtyUnit, link_path: str | Path, clock: Callable[[], float] = time.monotonic
    ) -> None:
        self.unit = unit
        self.link_path = Path(link_path)
        self._clock = clock
        self._master: int | None = None
        self._slave: int | None = None
        self._slave_name = ""
        self._outgoing = b""
        self._jobs: SimpleQueue[tuple[Callable[[], Any], Future[Any]]] = SimpleQueue()
        self._wake = os.eventfd(0, os.EFD_NONBLOCK | os.EFD_CLOEXEC)
        self._thread: threading.Thread | None = None
        self._serving: int | None = None  # ident of the serving thread, while one serves
        self._served = threading.Event()
        self._stop = threading.Event()

    @property
    def port(self) -> str:
        """The path that a driver opens."""
        return str(self.link_path)

    @property
    def plugged(self) -> bool:
        return self._master is not None

    # -- for a test or a control line; runs in the serving thread if there is one

    def call(self, job: Callable[[], T], timeout_s: float = 5.0) -> T:
        """Run `job` in the serving thread and return its result (here, if nothing serves)."""
        if self._serving is None or self._serving == threading.get_ident():
            return job()
        future: Future[T] = Future()
        self._jobs.put((job, future))
        self.wake()
        return future.result(timeout_s)

    def plug(self) -> None:
        """Make the pty and its link; does nothing if they exist."""
        self.call(self._plug)

    def unplug(self) -> None:
        """Close the pty and remove the link: a client that has it open gets EIO."""
        self.call(self._unplug)

    def stall_writes(self, on: bool) -> None:
        """While on, the host cannot send a byte: its write blocks until its time-out."""
        self.call(lambda: self._stall(on))

    def fault(self, **changes: Any) -> None:
        """Switch faults (fields of the unit's) at run time; unknown names raise TypeError."""
        self.call(lambda: self._set_faults(structs.replace(self.unit.faults, **changes)))

    def clear_faults(self) -> None:
        """Restore a healthy unit and a port that accepts bytes."""
        self.call(lambda: self._set_faults(type(self.unit.faults)()))
        self.stall_writes(False)

    def _set_faults(self, faults: Any) -> None:
        self.unit.faults = faults

    def wake(self) -> None:
        """Make the loop look at the unit again (a job or a fault changed what is due)."""
        os.eventfd_write(self._wake, 1)

    # -- running

    def start(self) -> Self:
        """Plug in and serve in a separate thread; return when a client can open the port."""
        if self._thread is not None:
            return self
        self._plug()
        self._stop.clear()
        self._thread = threading.Thread(
            target=serve, args=([self], self._stop), name=f"pty {self.link_path.name}", daemon=True
        )
        self._thread.start()
        self._served.wait()
        return self

    def stop(self) -> None:
        """End the thread and remove the pty and its link. Safe to call twice."""
        self._stop.set()
        if self._thread is not None:
            self.wake()
            self._thread.join()
            self._thread = None
        self._unplug()

    def __del__(self) -> None:
        with contextlib.suppress(OSError, AttributeError):
            os.close(self._wake)

    def __enter__(self) -> Self:
        return self.start()

    def __exit__(self, *_: object) -> None:
        self.stop()

    # -- in the serving thread only

    def _plug(self) -> None:
        if self._master is not None:
            return
        master, slave = os.openpty()
        tty.setraw(slave, termios.TCSANOW)
        os.set_blocking(master, False)
        self._master, self._slave, self._slave_name = master, slave, os.ttyname(slave)
        fresh = self.link_path.with_name(f".{self.link_path.name}.{os.getpid()}")
        with contextlib.suppress(FileNotFoundError):
            fresh.unlink()
        fresh.symlink_to(self._slave_name)
        os.replace(fresh, self.link_path)

    def _unplug(self) -> None:
        if self._master is None or self._slave is None:
            return
        # Remove only our own link: another server may have taken over the path.
        if self.link_path.is_symlink() and os.readlink(self.link_path) == self._slave_name:
            self.link_path.unlink()
        os.close(self._master)
        os.close(self._slave)
        self._master = self._slave = None
        self._outgoing = b""
        self.unit.link_lost()

    def _stall(self, on: bool) -> None:
        if self._slave is not None:
            termios.tcflow(self._slave, termios.TCOOFF if on else termios.TCOON)

    def _run_jobs(self) -> None:
        with contextlib.suppress(BlockingIOError):
            os.eventfd_read(self._wake)
        while not self._jobs.empty():
            job, future = self._jobs.get()
            try:
                future.set_result(job())
            except BaseException as error:  # passed to the caller of call()
                future.set_exception(error)

    def _receive(self) -> None:
        if self._master is None:
            return
        try:
            data = os.read(self._master, 65536)
        except (BlockingIOError, OSError):  # EIO: a client hung up at this moment
            return
        self.unit.feed(data)

    def _transmit(self) -> None:
        """Write what is due, one unit chunk per write; keep what the pty does not accept."""
        while self._master is not None:
            if not self._outgoing:
                self._outgoing = self.unit.take()
                if not self._outgoing:
                    return
            try:
                written = os.write(self._master, self._outgoing)
            except BlockingIOError:
                return
            except OSError:
                written = len(self._outgoing)
            self._outgoing = self._outgoing[written:]

    def _sleep_s(self) -> float:
        due = self.unit.next_due_s()
        return LONGEST_SLEEP_S if due is None else max(0.0, due - self._clock())


Control = tuple[int, Callable[[bytes], None]]
"""A further file descriptor that the loop watches, and the function that takes the bytes read from
it. b"" (end of file) is passed once; then the descriptor is dropped."""


def serve(
    servers: Sequence[PtyServer], stop: threading.Event, controls: Sequence[Control] = ()
) -> None:
    """Serve several ptys in this thread until `stop` is set, so that units which share a plant need
    no lock. `stop` is noticed within LONGEST_SLEEP_S, or at once after a server's wake()."""
    watched = dict(controls)
    for server in servers:
        server._plug()
        server._serving = threading.get_ident()
        server._served.set()
    try:
        while not stop.is_set():
            masters = {s._master: s for s in servers if s._master is not None}
            blocked = [fd for fd, s in masters.items() if s._outgoing]
            sleep_s = min(
                (s._sleep_s() for s in servers if not s._outgoing), default=LONGEST_SLEEP_S
            )
            ready, _, _ = select.select(
                [*masters, *(s._wake for s in servers), *watched],
                blocked,
                [],
                min(sleep_s, LONGEST_SLEEP_S),
            )
            for fd in [fd for fd in ready if fd in watched]:
                data = os.read(fd, 65536)
                watched[fd](data)
                if not data:
                    del watched[fd]
            for server in servers:
                if server._wake in ready:
                    server._run_jobs()
                if server._master in ready:
                    server._receive()
                server._transmit()
    finally:
        for server in servers:
            server._serving = None
            server._served.clear()
            server._run_jobs()
