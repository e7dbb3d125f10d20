"""Recordings that grow row by row, one class for each kind of file.

.csv     line by line; the file is whole at every moment
.csv.gz  in blocks, each a gzip member of its own: what is there can be unpacked at every moment
.mcap    in chunks; a file whose writer was killed is read by `dehyst convert --unfinished`
.npz     written when it is closed: until then the rows are in memory
"""

import gzip
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from dehyst.daemon.files.appended import AppendedFile, RecordingFailed
from dehyst.daemon.files.csv_table import MOST_BYTES
from dehyst.daemon.files.mcap_file import McapRows
from dehyst.daemon.files.number_text import number_texts
from dehyst.daemon.files.recordings import WRITTEN, write_recording
from dehyst.daemon.files.sidecar import write_notes
from dehyst.models.errors import BadInput

Columns = Sequence[NDArray[Any]]
PACKED_BLOCK, PACKED_LEVEL = 256 << 10, 4


class Rows(Protocol):
    """rows: that the file holds, or will when it is closed; size: bytes on the disk; full: no
    more fits."""

    @property
    def rows(self) -> int: ...

    @property
    def size(self) -> int: ...

    @property
    def full(self) -> bool: ...

    def add(self, columns: Columns) -> None:
        """Append (n,) values of each column. Raises RecordingFailed."""
        ...

    def close(self) -> None:
        """Write what is still held, and close. Raises RecordingFailed."""
        ...


def check_kind(path: Path) -> None:
    """BadInput where no recording of that suffix is written."""
    if not path.name.endswith(WRITTEN):
        raise BadInput(f"{path}: unknown kind of file; {', '.join(WRITTEN)} are written")


def open_rows(path: Path, names: Sequence[str], notes: Mapping[str, str], replace: bool) -> Rows:
    """A growing recording with these columns, `t_s` first; its suffix says which kind. Raises
    BadInput where it cannot be made."""
    check_kind(path)
    file = AppendedFile(path, replace)
    try:
        if path.suffix == ".mcap":
            return McapRows(file, names, notes)
        if path.suffix == ".npz":
            file.close()
            return NpzRows(path, names, notes)
        rows = CsvRows(file, names, path.suffix == ".gz")
        write_notes(path, notes)
        return rows
    except OSError as error:
        raise BadInput(f"{path}: cannot be written: {error.strerror}") from None


class CsvRows:
    """See the module."""

    full = False

    def __init__(self, file: AppendedFile, names: Sequence[str], packed: bool) -> None:
        self.rows = 0
        self._file, self._packed = file, packed
        self._waiting: list[str] = []
        self._waiting_rows = self._waiting_size = 0
        self._failed = False
        self._take(",".join(names) + "\n", 0)

    @property
    def size(self) -> int:
        """Bytes on the disk."""
        return self._file.size

    def add(self, columns: Columns) -> None:
        """See Rows."""
        texts = [number_texts(column, "") for column in columns]
        lines = [",".join(row) for row in zip(*texts, strict=True)]
        if lines:
            self._take("\n".join(lines) + "\n", len(lines))

    def close(self) -> None:
        """See Rows."""
        try:
            if not self._failed:
                self._pack()
        finally:
            self._file.close()

    def _take(self, text: str, rows: int) -> None:
        if self._packed:
            self._waiting.append(text)
            self._waiting_rows += rows
            self._waiting_size += len(text)
            self.rows += rows
            if self._waiting_size >= PACKED_BLOCK:
                self._pack()
            return
        data, before = text.encode(), self._file.size
        try:
            self._file.write(data, b"\n")
        except RecordingFailed:
            self._failed = True
            self.rows += data[: self._file.size - before].count(b"\n") if rows else 0
            raise
        self.rows += rows

    def _pack(self) -> None:
        if not self._waiting:
            return
        block, rows = "".join(self._waiting).encode(), self._waiting_rows
        self._waiting, self._waiting_rows, self._waiting_size = [], 0, 0
        try:
            self._file.write(gzip.compress(block, PACKED_LEVEL, mtime=0))
        except RecordingFailed:
            self._failed = True
            self.rows -= rows
            raise


class NpzRows:
    """See the module."""

    def __init__(self, path: Path, names: Sequence[str], notes: Mapping[str, str]) -> None:
        self.rows = self.size = 0  # size: at most, until it is written
        self._path, self._names, self._notes = path, names, notes
        self._parts: list[Columns] = []
        self._closed = False

    @property
    def full(self) -> bool:
        """Whether it holds as much as may be read back."""
        return 8 * self.rows * len(self._names) > MOST_BYTES // 2

    def add(self, columns: Columns) -> None:
        """See Rows."""
        if self.full:
            raise RecordingFailed(
                f"{self._path}: an .npz file takes no more than {self.rows} rows; begin another "
                "one, or record with --rotate"
            )
        self._parts.append([np.array(column) for column in columns])
        self.rows += len(columns[0])
        self.size = 8 * self.rows * len(self._names)

    def close(self) -> None:
        """See Rows."""
        if self._closed:
            return
        self._closed = True
        empty: list[Columns] = [[np.empty(0) for _ in self._names]]
        whole = [np.concatenate(parts) for parts in zip(*(self._parts or empty), strict=True)]
        self._parts = []
        columns = dict(zip(self._names[1:], whole[1:], strict=True))
        write_recording(self._path, whole[0], columns, self._notes)
        self.size = self._path.stat().st_size
