"""Layout of a ring in its file: a header of 64-bit words, a check for each record, the records.

    words   (16,) int64      magic, layout, capacity, record size, head, tail, run, writer's pid
    checks  (capacity,)      digest of each record and its number
    records (capacity,)      of one numpy dtype

Record number n is at place n modulo capacity. A record is valid only with its check, so every
reader detects one that was damaged, half written or overwritten meanwhile.
"""

from typing import Any

import numpy as np
from numpy.typing import NDArray

MAGIC = 0x6465687973743032  # "dehyst02"
HEADER_WORDS = 16
MAGIC_AT, LAYOUT_AT, CAPACITY_AT, ITEM_AT, HEAD, TAIL, RUN, PID = range(8)
MOST_RECORDS = 1 << 24  # a header that claims more is damaged; the loop's rings have 1 << 16
MOST_WRITTEN = 1 << 62
"""No writer reaches this count (at 20 kHz it takes 7 million years): a larger one is damage."""
PRIME, BASIS = 1099511628211, 14695981039346656037  # FNV-1a (Fowler, Noll, Vo), 64 bits
FARTHEST = 1 << 48
"""A head further ahead of a reader than this is damage, not a slow reader."""


def layout_of(dtype: np.dtype[Any]) -> int:
    """Return a number that changes with the record's layout."""
    value = 1469598103934665603
    for byte in repr(dtype.descr).encode():
        value = ((value ^ byte) * PRIME) & 0x7FFFFFFFFFFFFFFF
    return value


def counted(word: int) -> int:
    """Return a count of the header, or 0 where no writer could have written it."""
    return int(word) if 0 <= word <= MOST_WRITTEN else 0


def size_of(dtype: np.dtype[Any], capacity: int) -> int:
    """Return the size of a ring's file in bytes."""
    return 8 * HEADER_WORDS + capacity * (8 + dtype.itemsize)


def what_is_wrong(words: NDArray[np.int64], size: int, dtype: np.dtype[Any]) -> str:
    """Return why a file with this header (16,) and size is no ring of this dtype; "": it is."""
    if words.size < HEADER_WORDS or words[MAGIC_AT] != MAGIC:
        return "not a ring of this version of dehyst"
    if words[LAYOUT_AT] != layout_of(dtype) or words[ITEM_AT] != dtype.itemsize:
        return "a ring of another version of dehyst"
    capacity = int(words[CAPACITY_AT])
    if not 0 < capacity <= MOST_RECORDS or size != size_of(dtype, capacity):
        return "a damaged ring"
    return ""


def digests(records: NDArray[Any], numbers: NDArray[np.int64]) -> NDArray[np.int64]:
    """Return the checks (n,) of records (n,) with these numbers (n,). The compiled
    dehyst.daemon.rings.ring.digest computes the same for one record."""
    data = records.view(np.uint8).reshape(records.size, records.dtype.itemsize)
    value = np.uint64(BASIS) ^ numbers.astype(np.uint64)
    prime = np.uint64(PRIME)
    value = value * prime
    for column in data.T:
        value = (value ^ column) * prime
    return value.view(np.int64)
