"""Memory-mapped rings between the loop's process and the network's process.

Each ring is one file (see dehyst.daemon.rings.layout). One process writes, one reads; neither ever
waits for the other. The writer publishes by storing the record and its check first and the head
afterwards, with a full fence between (needed on aarch64, free on x86-64). A reader that lags
by more than the ring's capacity loses the oldest records, learns how many, and never sees a
torn one, because each record is verified against its check after it was copied.

The ring maps a plain file instead of multiprocessing.SharedMemory: up to Python 3.12 the latter
unlinks the segment when the *attaching* process exits.
"""

import mmap
import os
import secrets
import weakref
from pathlib import Path
from typing import Any

import numpy as np
from numba import njit, types
from numba.extending import intrinsic
from numpy.typing import NDArray

from dehyst.daemon.rings.layout import (
    BASIS,
    CAPACITY_AT,
    FARTHEST,
    HEAD,
    HEADER_WORDS,
    ITEM_AT,
    LAYOUT_AT,
    MAGIC,
    MAGIC_AT,
    PID,
    PRIME,
    RUN,
    TAIL,
    counted,
    layout_of,
    size_of,
    what_is_wrong,
)
from dehyst.models.errors import BadInput, NotNow

FIXED = (MAGIC_AT, LAYOUT_AT, CAPACITY_AT, ITEM_AT, RUN, PID)
_BASIS, _PRIME = np.uint64(BASIS), np.uint64(PRIME)


@intrinsic
def _fence(typingctx: Any) -> Any:
    def codegen(context: Any, builder: Any, signature: Any, args: Any) -> Any:
        builder.fence("seq_cst")
        return context.get_dummy_value()

    return types.void(), codegen


@njit(cache=True, nogil=True)
def store(words: NDArray[np.int64], index: int, value: int) -> None:
    """Write a header word so that everything written before it becomes visible before it."""
    _fence()
    words[index] = value
    _fence()


@njit(cache=True, nogil=True)
def load_word(words: NDArray[np.int64], index: int) -> int:
    """Read a header word from memory again."""
    _fence()
    value = words[index]
    _fence()
    return value


@njit(cache=True, nogil=True)
def digest(data: NDArray[np.uint8], number: int) -> int:
    """Return the check of a record (its bytes) with its number: FNV-1a."""
    value = (_BASIS ^ np.uint64(number)) * _PRIME
    for byte in data:
        value = (value ^ np.uint64(byte)) * _PRIME
    return np.int64(value)  # type: ignore[return-value]


@njit(cache=True, nogil=True)
def _seal(data: NDArray[np.uint8], checks: NDArray[np.int64], first: int, count: int) -> None:
    """Store the checks of `count` records that were just written."""
    for number in range(first, first + count):
        place = number % checks.size
        checks[place] = digest(data[place], number)


@njit(cache=True, nogil=True)
def _whole(
    data: NDArray[np.uint8], checks: NDArray[np.int64], first: int, whole: NDArray[np.bool_]
) -> None:
    """Write to `whole` which of the records from `first` on agree with their checks."""
    for i in range(whole.size):
        place = (first + i) % checks.size
        whole[i] = checks[place] == digest(data[place], first + i)


class Ring:
    """A ring in a file. `create` makes and owns it, `attach` opens an existing one.

    `words`: the header as (16,) int64; `records`: (capacity,) structured array; `checks`:
    (capacity,) int64; `data`: the records as (capacity, record size) bytes; all of them
    memory-mapped. `run`: number of the writer's run. `damaged`: number of records that this reader
    dropped because their check did not agree.
    """

    def __init__(
        self, path: Path, mapping: mmap.mmap, dtype: np.dtype[Any], file: int, capacity: int
    ) -> None:
        self.path, self._mapping, self._file = path, mapping, file
        # a file that is not closed explicitly is closed with its last reference
        self._end = weakref.finalize(self, os.close, file) if file >= 0 else lambda: None
        self.words: NDArray[np.int64] = np.frombuffer(mapping, np.int64, HEADER_WORDS)
        self.capacity, start = capacity, 8 * HEADER_WORDS
        self.checks: NDArray[np.int64] = np.frombuffer(mapping, np.int64, capacity, offset=start)
        self.records: NDArray[Any] = np.frombuffer(
            mapping, dtype, capacity, offset=start + 8 * capacity
        )
        self.data = self.records.view(np.uint8).reshape(capacity, dtype.itemsize)
        self._header = self.words[list(FIXED)].copy()
        self._inode = os.fstat(file).st_ino if file >= 0 else 0
        self.run = int(self.words[RUN])
        self.damaged = 0
        head = int(self.words[HEAD])
        # the writer uses its own count, and repairs the one in the file if others changed it
        self._written = head if 0 <= head < FARTHEST else 0

    @classmethod
    def create(cls, path: Path, dtype: np.dtype[Any], capacity: int, run: int = 1) -> "Ring":
        """Make a new ring file of `capacity` records, replacing an old one atomically.

        run: a number common to all rings of one writer, and new at each of its starts. A process
        that still maps the old file keeps it; `stale()` then returns True, and it must attach
        again. Raises NotNow where there is no room for it.
        """
        size = size_of(dtype, capacity)
        fresh = path.with_name(f"{path.name}.{secrets.token_hex(8)}.new")
        flags = os.O_RDWR | os.O_CREAT | os.O_EXCL | os.O_NOFOLLOW | os.O_CLOEXEC
        try:
            file = os.open(fresh, flags, 0o600)
        except OSError as error:
            raise NotNow(f"{path}: cannot be made: {error.strerror}") from None
        try:
            # written in full, not sparse: a full tmpfs fails here, not by SIGBUS in the loop
            with open(file, "wb", closefd=False) as out:
                out.write(bytes(size))
            mapping = mmap.mmap(file, size)
            words = np.frombuffer(mapping, np.int64, HEADER_WORDS)
            words[LAYOUT_AT], words[CAPACITY_AT] = layout_of(dtype), capacity
            words[ITEM_AT], words[RUN], words[PID] = dtype.itemsize, run, os.getpid()
            # make every page mapped and writable now, or the loop would fault at each new page
            np.frombuffer(mapping, np.uint8, size)[:: mmap.PAGESIZE] |= 0
            store(words, MAGIC_AT, MAGIC)
            os.replace(fresh, path)
        except OSError as error:
            os.close(file)
            fresh.unlink(missing_ok=True)
            raise NotNow(
                f"{path}: no ring can be made: {error.strerror}; make room, or set run_dir to a "
                "folder with room"
            ) from None
        return cls(path, mapping, dtype, file, capacity)

    @classmethod
    def scratch(cls, dtype: np.dtype[Any], capacity: int) -> "Ring":
        """Return a ring without a file, for one process."""
        return cls(Path(), mmap.mmap(-1, size_of(dtype, capacity)), dtype, -1, capacity)

    @classmethod
    def attach(cls, path: Path, dtype: np.dtype[Any]) -> "Ring":
        """Map an existing ring. Raises BadInput where it is missing, damaged or another user's."""
        try:
            file = os.open(path, os.O_RDWR | os.O_NOFOLLOW | os.O_CLOEXEC)
        except OSError as error:
            raise BadInput(f"{path}: no ring to attach to: {error.strerror}") from None
        try:
            found = os.fstat(file)
            words = np.frombuffer(os.pread(file, 8 * HEADER_WORDS, 0), np.uint8)
            header = words[: words.size // 8 * 8].view(np.int64)
            wrong = what_is_wrong(header, found.st_size, dtype)
            if found.st_uid != os.geteuid():
                wrong = f"it belongs to user {found.st_uid}"
            if wrong:
                raise BadInput(f"{path}: {wrong}; restart both processes")
            mapping = mmap.mmap(file, found.st_size)
        except (OSError, ValueError) as error:
            os.close(file)
            raise BadInput(f"{path}: no ring to attach to: {error}") from None
        except BadInput:
            os.close(file)
            raise
        return cls(path, mapping, dtype, file, int(header[CAPACITY_AT]))

    def stale(self) -> bool:
        """Return True when the file at `path` is not the mapped one. A ring whose file was removed
        continues to work: both sides still map it."""
        try:
            return os.stat(self.path).st_ino != self._inode
        except OSError:
            return False

    def mend(self) -> bool:
        """Let the writer check and repair its ring. Return False where the file was truncated or
        its header overwritten; both are then restored, and lost records are empty."""
        size = size_of(self.records.dtype, self.capacity)
        if self._file < 0:
            return True
        whole = os.fstat(self._file).st_size == size
        if not whole:
            os.ftruncate(self._file, size)
        if not whole or not np.array_equal(self.words[list(FIXED)], self._header):
            self.words[list(FIXED)] = self._header
            whole = False
        return whole

    @property
    def head(self) -> int:
        """Return the number of records written since the ring was made."""
        return counted(load_word(self.words, HEAD))

    @property
    def tail(self) -> int:
        """Return how many records the reader has read (see `taken`); it outlives the reader."""
        head, tail = self.head, counted(load_word(self.words, TAIL))
        return tail if 0 <= head - tail < FARTHEST else head - self.capacity

    @property
    def free(self) -> int:
        """Return how many records can be pushed before the reader loses one (see `taken`)."""
        return max(0, self.capacity - (self.head - self.tail))

    def push(self, record: Any) -> None:
        """Write one record, without waiting; a full ring overwrites its oldest one."""
        head = self._written
        self.records[head % self.capacity] = record
        _seal(self.data, self.checks, head, 1)
        self._written += 1
        store(self.words, HEAD, self._written)

    def push_many(self, records: NDArray[Any]) -> None:
        """Write up to `capacity` records and publish them at once."""
        head = self._written
        first = min(records.size, self.capacity - head % self.capacity)
        start = head % self.capacity
        self.records[start : start + first] = records[:first]
        self.records[: records.size - first] = records[first:]
        _seal(self.data, self.checks, head, records.size)
        self._written += records.size
        store(self.words, HEAD, self._written)

    def read(self, tail: int, limit: int | None = None) -> tuple[NDArray[Any], int, int]:
        """Return the records from number `tail` on: (copies, next tail, number of lost ones)."""
        head = self.head
        if not 0 <= head - tail < FARTHEST:  # the head was damaged: begin where it is now
            self.damaged += 1
            return self.records[:0].copy(), head, 0
        start = max(tail, head - self.capacity)
        stop = head if limit is None else min(head, start + limit)
        out = self.records[np.arange(start, stop) % self.capacity]
        # checked after the copy: a record overwritten meanwhile has another number
        whole = np.empty(out.size, np.bool_)
        _whole(self.data, self.checks, start, whole)
        if not whole.all():
            overwritten = max(0, min(self.head - self.capacity + 1 - start, out.size))
            self.damaged += int(np.count_nonzero(~whole[overwritten:]))
            out = out[whole]
        return out, stop, stop - tail - out.size

    def taken(self, tail: int) -> None:
        """Record how many records the reader has read, for the writer's `free`."""
        store(self.words, TAIL, tail)

    def close(self) -> None:
        """Close the mapping; the file stays for the other side."""
        del self.words, self.records, self.checks, self.data
        self._end()
        self._file = -1
        try:
            self._mapping.close()
        except BufferError:  # an array on it still exists; the process's end frees it
            return
