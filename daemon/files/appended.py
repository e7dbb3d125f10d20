"""A file that only grows, and that ends with something whole whatever happens to the disk."""

import os
from contextlib import suppress
from pathlib import Path
from typing import Self

from dehyst.drivers import system
from dehyst.models.errors import BadInput, DehystError


class RecordingFailed(DehystError):
    """The file could not be written further; `after` adds how much of it can be read."""

    def after(self, rows: int, by: str = "") -> Self:
        """The same, with how many rows can be read, and by which command where not every program
        reads them."""
        if isinstance(self, RecordingDeleted):
            return self
        how = f", by dehyst {by}" if by and rows else ""
        return type(self)(f"{self}; {rows} rows of it can be read{how}")


class RecordingDeleted(RecordingFailed):
    """The file was deleted; nothing of it can be read."""


class AppendedFile:
    """path: a new file unless `replace`. Raises BadInput where it cannot be made."""

    def __init__(self, path: Path, replace: bool) -> None:
        self.path = path
        self.size = 0
        """Bytes that are in the file."""
        try:
            existing = os.O_TRUNC if replace else os.O_EXCL
            kind = os.O_WRONLY | os.O_CREAT | system.CLOSE_ON_EXEC | system.BINARY
            self._file = os.open(path, kind | existing, 0o644)
        except OSError as error:
            raise BadInput(f"{path}: cannot be written: {error.strerror}") from None

    def write(self, data: bytes, end: bytes = b"", rows: int = 0) -> int:
        """Append. end: the bytes after which the file may end where not all of `data` can be
        written; b"": only before or after it; rows: that it holds. Raises RecordingFailed once it
        is cut to that, or where the file was deleted."""
        self.require_there(rows)
        left = memoryview(data)
        try:
            while left:
                left = left[os.write(self._file, left) :]
        except OSError as error:
            written = data[: len(data) - len(left)]
            self.size += written.rfind(end) + len(end) if end and end in written else 0
            with suppress(OSError):  # the disk is gone: the reader will name the broken end
                os.ftruncate(self._file, self.size)
            raise RecordingFailed(
                f"{self.path}: {error.strerror}; the recording ends here"
            ) from None
        self.size += len(data)
        return len(data)

    def require_there(self, rows: int) -> None:
        """Raise RecordingFailed where nobody can find the file any more. rows: that it held."""
        if self._file >= 0 and os.fstat(self._file).st_nlink == 0:
            lost = f"; its {rows} rows are lost" if rows else ""
            raise RecordingDeleted(f"{self.path}: was deleted while it was written{lost}")

    def flush(self) -> None:
        """Nothing is held back."""

    def tell(self) -> int:
        """Where the next bytes go."""
        return self.size

    def close(self) -> None:
        """Safe to call twice."""
        if self._file >= 0:
            os.close(self._file)
            self._file = -1
