"""Memory-mapped rings between the loop's process and the network's process.

One file a ring: a header of 64-bit words, then `capacity` records of one numpy dtype. One
process writes, one reads; neither ever waits for the other. The writer publishes by storing the
record first and the head afterwards, with a full fence between (needed on aarch64, free on
x86-64). A reader that is slower than the ring is long loses the oldest records, is told how many,
and never sees a torn one: after copying it looks at the head again.

A plain file is mapped, not multiprocessing.SharedMemory: up to Python 3.12 the latter unlinks
the segment when the *attaching* process exits.
"""

import mmap
import os
from pathlib import Path
from typing import Any

import numpy as np
from numba import njit, types
from numba.extending import intrinsic
from numpy.typing import NDArray

from dehyst.models.errors import BadInput

MAGIC = 0x6465687973743031  # "dehyst01"
HEADER_WORDS = 16
_MAGIC, _LAYOUT, _CAPACITY, _ITEM, HEAD, TAIL, _EPOCH = range(7)


@intrinsic
def _fence(typingctx: Any) -> Any:
    def codegen(context: Any, builder: Any, signature: Any, args: Any) -> Any:
        builder.fence("seq_cst")
        return context.get_dummy_value()

    return types.void(), codegen


@njit(cache=True, nogil=True)
def store(words: NDArray[np.int64], index: int, value: int) -> None:
    """Write a header word so that everything written before it is seen before it."""
    _fence()
    words[index] = value
    _fence()


@njit(cache=True, nogil=True)
def load(words: NDArray[np.int64], index: int) -> int:
    """Read a header word anew."""
    _fence()
    value = words[index]
    _fence()
    return value


def _layout(dtype: np.dtype[Any]) -> int:
    """A number that changes with the record's layout."""
    value = 1469598103934665603
    for byte in repr(dtype.descr).encode():
        value = ((value ^ byte) * 1099511628211) & 0x7FFFFFFFFFFFFFFF
    return value


class Ring:
    """A ring in a file. `create` makes and owns it, `attach` opens an existing one.

    words: the header as (16,) int64; records: (capacity,) structured array, both memory-mapped.
    """

    def __init__(self, path: Path, mapping: mmap.mmap, dtype: np.dtype[Any]) -> None:
        self.path, self._mapping = path, mapping
        self.words: NDArray[np.int64] = np.frombuffer(mapping, np.int64, HEADER_WORDS)
        self.capacity = int(self.words[_CAPACITY])
        self.records: NDArray[Any] = np.frombuffer(
            mapping, dtype, self.capacity, offset=8 * HEADER_WORDS
        )

    @classmethod
    def create(cls, path: Path, dtype: np.dtype[Any], capacity: int) -> "Ring":
        """Make a new ring file of `capacity` records, replacing an old one atomically.

        A process that still maps the old file keeps it; it sees by `stale()` that it must attach
        again.
        """
        size = 8 * HEADER_WORDS + capacity * dtype.itemsize
        path.parent.mkdir(parents=True, exist_ok=True)
        fresh = path.with_suffix(f".{os.getpid()}.new")
        with open(fresh, "w+b", opener=lambda p, f: os.open(p, f, 0o660)) as file:
            # written out, not sparse: a full tmpfs fails here and not as SIGBUS in the loop
            file.write(b"\0" * size)
            file.flush()
            mapping = mmap.mmap(file.fileno(), size)
        words = np.frombuffer(mapping, np.int64, HEADER_WORDS)
        words[_LAYOUT], words[_CAPACITY] = _layout(dtype), capacity
        words[_ITEM], words[_EPOCH] = dtype.itemsize, os.stat(fresh).st_ino
        # every page mapped and writable now, or the loop would fault at each new one
        np.frombuffer(mapping, np.uint8, size)[:: mmap.PAGESIZE] |= 0
        store(words, _MAGIC, MAGIC)
        os.replace(fresh, path)
        return cls(path, mapping, dtype)

    @classmethod
    def scratch(cls, dtype: np.dtype[Any], capacity: int) -> "Ring":
        """A ring without a file, for one process."""
        mapping = mmap.mmap(-1, 8 * HEADER_WORDS + capacity * dtype.itemsize)
        np.frombuffer(mapping, np.int64, HEADER_WORDS)[_CAPACITY] = capacity
        return cls(Path(), mapping, dtype)

    @classmethod
    def attach(cls, path: Path, dtype: np.dtype[Any]) -> "Ring":
        """Map an existing ring. Raises BadInput where it is missing or of another version."""
        try:
            with open(path, "r+b") as file:
                mapping = mmap.mmap(file.fileno(), 0)
        except (OSError, ValueError) as error:
            raise BadInput(f"{path}: no ring to attach to: {error}") from None
        words = np.frombuffer(mapping, np.int64, min(HEADER_WORDS, len(mapping) // 8))
        if words.size < HEADER_WORDS or words[_MAGIC] != MAGIC or words[_LAYOUT] != _layout(dtype):
            raise BadInput(f"{path}: not a ring of this version of dehyst; restart both processes")
        return cls(path, mapping, dtype)

    def stale(self) -> bool:
        """True when the file at `path` is no longer the one that is mapped."""
        try:
            return os.stat(self.path).st_ino != int(self.words[_EPOCH])
        except OSError:
            return True

    @property
    def head(self) -> int:
        """Number of records written since the ring was made."""
        return int(load(self.words, HEAD))

    @property
    def tail(self) -> int:
        """How far the reader has read (see `taken`); survives the reader."""
        return int(load(self.words, TAIL))

    @property
    def epoch(self) -> int:
        """Number of this ring file: another one means that its writer was started anew."""
        return int(self.words[_EPOCH])

    @property
    def free(self) -> int:
        """Records that can be pushed before the reader would lose one (see `taken`)."""
        return self.capacity - (self.head - int(load(self.words, TAIL)))

    def push(self, record: Any) -> None:
        """Write one record. Never waits; the oldest is overwritten."""
        head = int(self.words[HEAD])
        self.records[head % self.capacity] = record
        store(self.words, HEAD, head + 1)

    def push_many(self, records: NDArray[Any]) -> None:
        """Write up to `capacity` records and publish them at once."""
        head = int(self.words[HEAD])
        first = min(records.size, self.capacity - head % self.capacity)
        start = head % self.capacity
        self.records[start : start + first] = records[:first]
        self.records[: records.size - first] = records[first:]
        store(self.words, HEAD, head + records.size)

    def read(self, tail: int, limit: int | None = None) -> tuple[NDArray[Any], int, int]:
        """Records from number `tail` on: (copies, next tail, number lost before them)."""
        head = self.head
        start = max(tail, head - self.capacity)
        stop = head if limit is None else min(head, start + limit)
        out = self.records[np.arange(start, stop) % self.capacity]
        # what the writer may have overwritten while we copied, the record in progress included
        safe = self.head - self.capacity + 1
        if safe > start and start < stop:
            torn = min(safe - start, stop - start)
            out, start = out[torn:], start + torn
        return out, stop, start - tail

    def taken(self, tail: int) -> None:
        """The reader says how far it has read, for the writer's `free`."""
        store(self.words, TAIL, tail)

    def close(self) -> None:
        """Drop the mapping; the file stays for the other side."""
        del self.words, self.records
        try:
            self._mapping.close()
        except BufferError:  # somebody still holds an array on it; the process's end frees it
            return
