"""Read a ring as a file, for processes that must survive its damage: supervisor and `safe`.

If a mapped file is truncated, SIGBUS ends the process; a read only returns fewer bytes. Nothing
here needs the compiler.
"""

import os
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from dehyst.daemon.closing import Closing
from dehyst.daemon.rings.layout import (
    CAPACITY_AT,
    HEAD,
    HEADER_WORDS,
    PID,
    RUN,
    TAIL,
    counted,
    digests,
    what_is_wrong,
)
from dehyst.drivers import system
from dehyst.models.errors import BadInput


class RingFile(Closing):
    """Reader of the ring in the file at `path`. It and its methods raise BadInput where the ring is
    missing or damaged. `run`, `pid`: of its writer."""

    def __init__(self, path: Path, dtype: np.dtype[Any]) -> None:
        self.path, self._dtype, self._file = path, dtype, -1
        try:
            self._file = os.open(path, os.O_RDONLY | system.NO_FOLLOW | system.CLOSE_ON_EXEC)
            found = os.fstat(self._file)
        except OSError as error:
            raise BadInput(f"{path}: no ring to read: {error.strerror}") from None
        self._inode = found.st_ino
        try:
            if found.st_uid != system.user_id():
                raise BadInput(f"{path}: it belongs to user {found.st_uid}")
            words = self._words()
        except BadInput:
            self.close()
            raise
        self.capacity = int(words[CAPACITY_AT])
        self.run, self.pid = int(words[RUN]), int(words[PID])

    def _words(self) -> NDArray[np.int64]:
        words = np.frombuffer(self._bytes(8 * HEADER_WORDS, 0), np.int64)
        try:
            size = os.fstat(self._file).st_size
        except OSError as error:
            raise BadInput(f"{self.path}: {error.strerror}") from None
        if wrong := what_is_wrong(words, size, self._dtype):
            raise BadInput(f"{self.path}: {wrong}")
        return words

    def _bytes(self, count: int, offset: int) -> bytes:
        try:
            data = os.pread(self._file, count, offset)
        except OSError as error:
            raise BadInput(f"{self.path}: {error.strerror}") from None
        if len(data) != count:
            raise BadInput(f"{self.path}: a damaged ring: it is truncated")
        return data

    def place(self) -> tuple[int, int]:
        """Return (head, tail): number of records written, and number taken by the ring's reader."""
        words = self._words()
        return counted(words[HEAD]), counted(words[TAIL])

    def stale(self) -> bool:
        """Return True when the file at `path` is not the open one. After the file was removed, what
        its writer writes can still be read here."""
        try:
            return os.stat(self.path, follow_symlinks=False).st_ino != self._inode
        except OSError:
            return False

    def read(self, first: int = 0) -> tuple[NDArray[Any], int]:
        """Return (available undamaged records from number `first` on, the head)."""
        head, _ = self.place()
        numbers = np.arange(max(first, head - self.capacity, 0), head, dtype=np.int64)
        places = numbers % self.capacity
        start = 8 * HEADER_WORDS
        checks = np.frombuffer(self._bytes(8 * self.capacity, start), np.int64)[places]
        size = self._dtype.itemsize
        data = self._bytes(size * self.capacity, start + 8 * self.capacity)
        records = np.frombuffer(data, self._dtype)[places]
        return records[checks == digests(records, numbers)], head

    def close(self) -> None:
        """Close the file. Safe to call twice."""
        if self._file >= 0:
            os.close(self._file)
            self._file = -1
