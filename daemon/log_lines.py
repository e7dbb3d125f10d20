"""The log of a process that must keep running whatever happens to its stdout and stderr.

A write to a stopped terminal, a full or closed pipe or a full disk may block forever or fail. Here
a line is only put into a queue, and a thread writes it to the original stdout or stderr. A line for
which there is no room, or whose write fails, is dropped and counted; the count is reported with the
next line that can be written. Output of compiled code to descriptors 1 and 2 goes the same way:
they become pipes that never block.

All processes of one supervisor keep their counts in shared memory (`dropped`), which also records
whether one of them has printed a message for all (`first_to_say`).
"""

import faulthandler
import io
import os
import select
import signal
import sys
import threading
from collections import deque
from contextlib import suppress
from typing import Any

from dehyst.drivers import system
from dehyst.models.units import how_many

MOST_BYTES = 1 << 18
"""Largest queue [bytes]: a few thousand lines, in addition to what a kernel pipe holds."""
LAST_WORDS_S = 0.5
"""Longest time for which the end of the process waits for queued lines."""
COUNTS, SLOTS = "DEHYST_LOG_COUNTS", 16
PLACES = {"run": 0, "core": 1, "gateway": 2, "doctor": 3, "page": 4, "safe": 5, "emulate": 6}
"""Slot of each process' count, by command."""
SAID = SLOTS - 2
"""Slot that records whether one process has printed the message for all."""


class _Outlet:
    """The original target of one descriptor, and the thread that writes to it."""

    def __init__(self, file: int, who: str) -> None:
        self._file, self._who = file, who
        self._waiting: deque[bytes] = deque()
        self._bytes = self._unsaid = self.dropped = 0
        self._busy = False
        self._change = threading.Condition(threading.RLock())
        threading.Thread(target=self._run, name="log", daemon=True).start()

    def put(self, data: bytes) -> None:
        """Queue data to be written; never blocks."""
        with self._change:
            if self._bytes + len(data) > MOST_BYTES:
                self._drop(data)
                return
            self._waiting.append(data)
            self._bytes += len(data)
            self._change.notify_all()

    def flush(self, seconds: float) -> None:
        """Wait until all data is written, at most this long."""
        with self._change:
            self._change.wait_for(lambda: not self._waiting and not self._busy, seconds)

    def _drop(self, data: bytes) -> None:
        lines = max(1, data.count(b"\n"))
        self.dropped += lines
        self._unsaid += lines
        _count(self._who, lines)

    def _run(self) -> None:
        while True:
            with self._change:
                self._busy = False
                self._change.notify_all()
                self._change.wait_for(lambda: bool(self._waiting))
                data = self._waiting.popleft()
                self._bytes -= len(data)
                self._busy, unsaid = True, self._unsaid
            said = (
                f"dehyst {self._who}: {how_many(unsaid, 'line')} of the log could not be written\n"
            )
            try:
                self._write(said.encode() + data if unsaid else data)
            except OSError:  # full, closed, gone
                with self._change:
                    self._drop(data)
            else:
                with self._change:
                    self._unsaid -= unsaid

    def _write(self, data: bytes) -> None:
        while data:
            try:
                data = data[os.write(self._file, data) :]
            except BlockingIOError:  # another user of the file has made it non-blocking
                select.select([], [self._file], [])


class _Words(io.TextIOBase):
    """The stream that print() writes to; it passes whole lines to the outlet."""

    def __init__(self, outlet: _Outlet, number: int, terminal: bool) -> None:
        self._outlet, self._number, self._terminal = outlet, number, terminal
        self._line = threading.local()

    encoding, errors = "utf-8", "backslashreplace"

    def write(self, text: str) -> int:
        begun = getattr(self._line, "text", "") + text
        whole, mark, self._line.text = begun.rpartition("\n")
        if mark:
            self._outlet.put((whole + mark).encode("utf-8", "backslashreplace"))
        return len(text)

    def flush(self) -> None:
        left, self._line.text = getattr(self._line, "text", ""), ""
        if left:
            self._outlet.put(left.encode("utf-8", "backslashreplace"))

    def writable(self) -> bool:
        return True

    def isatty(self) -> bool:
        return self._terminal

    def fileno(self) -> int:
        return self._number


class Log:
    """Replaces stdout and stderr of this process. who: the command, named in messages; files:
    copies of the original stdout and stderr, for child processes, which have their own logs."""

    def __init__(self, who: str) -> None:
        # a terminal may stop a background process that writes to it; this one ignores that
        signal.signal(signal.SIGTTOU, signal.SIG_IGN)
        self.files = [_kept(number) for number in (1, 2)]
        if faulthandler.is_enabled():  # by $PYTHONFAULTHANDLER; no thread can write after a crash
            faulthandler.enable(self.files[1])
        outlets = [_Outlet(file, who) for file in self.files]
        if os.path.sameopenfile(*self.files):
            outlets[0] = outlets[1]
        self._outlets, sources = outlets, {}
        for number, outlet in zip((1, 2), outlets, strict=True):
            terminal = os.isatty(number)
            read, write = os.pipe2(os.O_CLOEXEC)
            os.set_blocking(write, False)
            os.dup2(write, number)
            os.close(write)
            sources[read] = outlet
            words = _Words(outlet, number, terminal)
            setattr(sys, ("stdout", "stderr")[number - 1], words)
        threading.Thread(target=_pass_on, args=(sources,), name="log-pipes", daemon=True).start()

    def flush(self) -> None:
        """Write what is still queued, as far as possible within LAST_WORDS_S per outlet."""
        for outlet in self._outlets:
            outlet.flush(LAST_WORDS_S)


def _kept(number: int) -> int:
    """Duplicate a descriptor; return one of /dev/null if it is closed."""
    import fcntl  # POSIX only; this log is for long-lived processes on Linux

    try:
        return fcntl.fcntl(number, fcntl.F_DUPFD_CLOEXEC, 3)
    except OSError:
        nowhere = os.open(os.devnull, os.O_WRONLY | os.O_CLOEXEC)
        try:
            return fcntl.fcntl(nowhere, fcntl.F_DUPFD_CLOEXEC, 3)
        finally:
            os.close(nowhere)


def _pass_on(sources: dict[int, _Outlet]) -> None:
    """Pass what compiled code writes to the outlets."""
    while True:
        for read in select.select(list(sources), [], [])[0]:
            sources[read].put(os.read(read, 1 << 16))


_log: Log | None = None
_counts = -1


def keep_going(who: str) -> None:
    """Install the log: from now on, no write to stdout or stderr can stop this process."""
    global _log
    if _log is not None:
        return
    _share_counts()
    _log = Log(who)


def _share_counts() -> int:
    """Return the descriptor of the supervisor's counts, or of new ones in the first process."""
    global _counts
    given = os.environ.pop(COUNTS, "")
    if _counts >= 0:
        return _counts
    with suppress(ValueError, OSError):
        if os.readlink(f"/proc/self/fd/{int(given)}").startswith(f"/memfd:{COUNTS}"):
            _counts = int(given)
            os.set_inheritable(_counts, False)
    if _counts < 0:
        _counts = os.memfd_create(COUNTS)
        os.ftruncate(_counts, 8 * SLOTS)
    return _counts


def first_to_say() -> bool:
    """Return True for the first process, among those that share counts, that calls this."""
    if not system.LINUX:
        return True
    import fcntl  # POSIX only

    counts = _share_counts()
    fcntl.lockf(counts, fcntl.LOCK_EX, 8, 8 * SAID)  # two processes may call this at once
    try:
        said = any(os.pread(counts, 8, 8 * SAID))
        os.pwrite(counts, b"\1", 8 * SAID)
    finally:
        fcntl.lockf(counts, fcntl.LOCK_UN, 8, 8 * SAID)
    return not said


def last_words() -> None:
    """Wait briefly for queued lines before the process ends."""
    if _log is not None:
        with suppress(OSError, ValueError):
            sys.stdout.flush()
            sys.stderr.flush()
        _log.flush()


def for_child() -> dict[str, Any]:
    """Return arguments for subprocess.Popen. A child writes to the original stdout and stderr of
    this process, not through it, because it may end first, and shares its counts."""
    counts = _share_counts()
    environment = {**os.environ, "DEHYST_SUPERVISED": str(os.getpid()), COUNTS: str(counts)}
    shared = {"env": environment, "pass_fds": (counts,)}
    if _log is None:
        return shared
    stdout, stderr = _log.files
    return {**shared, "stdout": stdout, "stderr": stderr}


def dropped() -> int:
    """Return the number of lines that this process and those sharing its counts dropped."""
    try:
        data = os.pread(_counts, 8 * SLOTS, 0)
    except OSError:
        return 0
    return sum(
        int.from_bytes(data[8 * i : 8 * i + 8], "little")
        for i in range(len(data) // 8)
        if i != SAID
    )


def _count(who: str, lines: int) -> None:
    place = 8 * PLACES.get(who, SLOTS - 1)
    with suppress(OSError):
        before = int.from_bytes(os.pread(_counts, 8, place), "little")
        os.pwrite(_counts, (before + lines).to_bytes(8, "little"), place)
