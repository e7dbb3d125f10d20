"""A file that only grows, and that always ends with a complete record, whatever happens to the
disk."""

import os
from contextlib import suppress
from pathlib import Path
from typing import Self

from dehyst.daemon.files.outputs import report_failures
from dehyst.drivers import system
from dehyst.models.errors import DehystError
from dehyst.models.units import how_many


class RecordingFailed(DehystError):
    """The file could not be extended; `after` adds how many rows can be read."""

    def after(self, rows: int, by: str = "") -> Self:
        """Return the same error with the number of readable rows, and the command that reads them
        if not every program can."""
        if isinstance(self, RecordingDeleted | NothingRecorded):
            return self
        how = f", by dehyst {by}" if by and rows else ""
        return type(self)(f"{self}; {how_many(rows, 'row')} of it can be read{how}")


class NothingRecorded(RecordingFailed):
    """Not even the head of the file could be written; the file was removed."""


class RecordingDeleted(RecordingFailed):
    """The file was deleted; none of it can be read."""


class AppendedFile:
    """path: a new file unless `replace`. Raises BadInput if it cannot be created."""

    def __init__(self, path: Path, replace: bool) -> None:
        self.path = path
        self.size = 0
        """Bytes that are in the file."""
        with report_failures(path):
            existing = os.O_TRUNC if replace else os.O_EXCL
            kind = os.O_WRONLY | os.O_CREAT | system.CLOSE_ON_EXEC | system.BINARY
            self._file = os.open(path, kind | existing, 0o644)

    def write(self, data: bytes, end: bytes = b"", rows: int = 0) -> int:
        """Append data, and return its length. end: bytes after which the file may be cut if not all
        of `data` can be written; b"": write all or nothing; rows: that the file holds. Raises
        RecordingFailed after cutting the file, or if it was deleted."""
        self.require_there(rows)
        left = memoryview(data)
        try:
            while left:
                left = left[os.write(self._file, left) :]
        except OSError as error:
            written = data[: len(data) - len(left)]
            self.size += written.rfind(end) + len(end) if end and end in written else 0
            with suppress(OSError):  # the disk is gone: the reader will report the broken end
                os.ftruncate(self._file, self.size)
            if not self.size:
                with suppress(OSError):
                    self.path.unlink()
                raise NothingRecorded(
                    f"{self.path}: {error.strerror}; nothing was recorded"
                ) from None
            raise RecordingFailed(
                f"{self.path}: {error.strerror}; the recording ends here"
            ) from None
        self.size += len(data)
        return len(data)

    def require_there(self, rows: int) -> None:
        """Raise RecordingFailed if the file was deleted. rows: that it held."""
        if self._file >= 0 and os.fstat(self._file).st_nlink == 0:
            lost = f"; {how_many(rows, 'row of it is', 'rows of it are')} lost" if rows else ""
            raise RecordingDeleted(f"{self.path}: was deleted while it was written{lost}")

    def flush(self) -> None:
        """Do nothing: no data is held back."""

    def tell(self) -> int:
        """Return the position of the next bytes."""
        return self.size

    def close(self) -> None:
        """Close the file; safe to call twice."""
        if self._file >= 0:
            os.close(self._file)
            self._file = -1
