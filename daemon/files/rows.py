"""Recordings that grow row by row, with one class for each kind of file.

.csv     written line by line
.csv.gz  written in blocks, each a separate gzip member
.mcap    written in chunks
.npz     written in blocks of numbers, converted into the archive on closing

A block holds at most HELD_S of recorded time, so a kill or a full disk loses no more than that.
`dehyst convert --unfinished` reads the complete part of every kind. Deleting the file while it
grows is an error.
"""

import gzip
import io
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from dehyst.daemon.files.appended import AppendedFile, RecordingFailed
from dehyst.daemon.files.csv_table import MOST_BYTES
from dehyst.daemon.files.mcap_file import McapRows
from dehyst.daemon.files.number_text import number_texts
from dehyst.daemon.files.outputs import report_failures
from dehyst.daemon.files.recordings import WRITTEN, write_recording
from dehyst.daemon.files.sidecar import write_notes
from dehyst.daemon.files.unfinished import read_blocks
from dehyst.models.errors import BadInput

Columns = Sequence[NDArray[Any]]
PACKED_BLOCK, PACKED_LEVEL = 256 << 10, 4
HELD_S = 2.0
"""Longest recorded time in rows that are not yet in the file."""


class RowWriter(Protocol):
    """rows: that the file holds, or will hold once closed; size: bytes on the disk; full: no more
    rows fit."""

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
        """Write the rows still held, and close. Raises RecordingFailed."""
        ...


def check_kind(path: Path) -> None:
    """Raise BadInput if no recording with this suffix can be written."""
    if not path.name.endswith(WRITTEN):
        raise BadInput(f"{path}: unknown kind of file; {', '.join(WRITTEN)} are written")


def open_rows(
    path: Path, names: Sequence[str], notes: Mapping[str, str], replace: bool
) -> RowWriter:
    """Open a growing recording with these columns, `t_s` first; its suffix selects the kind. Raises
    BadInput if the file cannot be created."""
    check_kind(path)
    file = AppendedFile(path, replace)
    with report_failures(path):
        if path.suffix == ".mcap":
            return McapRows(file, names, notes)
        if path.suffix == ".npz":
            return NpzRows(file, path, names, notes)
        rows = CsvRows(file, names, path.suffix == ".gz")
        write_notes(path, notes)
        return rows


class CsvRows:
    """Writer for .csv and .csv.gz: see the module."""

    full = False

    def __init__(self, file: AppendedFile, names: Sequence[str], packed: bool) -> None:
        self.rows = 0
        self._file, self._packed = file, packed
        self._waiting: list[str] = []
        self._waiting_rows = self._waiting_size = 0
        self._waiting_from_s = 0.0
        self._failed = False
        self._take(",".join(names) + "\n", 0)

    @property
    def size(self) -> int:
        """Bytes on the disk."""
        return self._file.size

    def add(self, columns: Columns) -> None:
        """See RowWriter."""
        texts = [number_texts(column, "") for column in columns]
        lines = [",".join(row) for row in zip(*texts, strict=True)]
        if not lines:
            return
        if not self._waiting_rows:
            self._waiting_from_s = float(columns[0][0])
        self._take("\n".join(lines) + "\n", len(lines))
        if self._waiting_rows and float(columns[0][-1]) - self._waiting_from_s >= HELD_S:
            self._pack()

    def close(self) -> None:
        """See RowWriter."""
        try:
            if not self._failed:
                self._pack()
                self._file.require_there(self.rows)
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
            self._file.write(data, b"\n", self.rows)
        except RecordingFailed as failed:
            self._failed = True
            self.rows += data[: self._file.size - before].count(b"\n") if rows else 0
            raise failed.after(self.rows) from None
        self.rows += rows

    def _pack(self) -> None:
        if not self._waiting:
            return
        block, rows = "".join(self._waiting).encode(), self._waiting_rows
        self._waiting, self._waiting_rows, self._waiting_size = [], 0, 0
        try:
            self._file.write(gzip.compress(block, PACKED_LEVEL, mtime=0))
        except RecordingFailed as failed:
            self._failed = True
            self.rows -= rows
            raise failed.after(self.rows) from None


class NpzRows:
    """Writer for .npz: see the module. file: receives the blocks; the finished archive replaces
    it."""

    def __init__(
        self, file: AppendedFile, path: Path, names: Sequence[str], notes: Mapping[str, str]
    ) -> None:
        self.rows = 0
        self._file, self._path, self._names, self._notes = file, path, names, notes
        self._closed = self._failed = False
        self._write(np.array(names))
        self._write(np.array([[key, str(text)] for key, text in notes.items()] or [["", ""]]))

    @property
    def size(self) -> int:
        """Bytes written so far."""
        return self._file.size

    @property
    def full(self) -> bool:
        """Whether the file holds as much as can be read back."""
        return 8 * self.rows * len(self._names) > MOST_BYTES // 2

    def add(self, columns: Columns) -> None:
        """See RowWriter."""
        if self.full:
            raise RecordingFailed(
                f"{self._path}: an .npz file takes no more than {self.rows} rows; begin another "
                "one, or record with --rotate"
            )
        self._write(np.stack([np.asarray(column, np.float64) for column in columns], axis=1))
        self.rows += len(columns[0])

    def _write(self, block: NDArray[Any]) -> None:
        packed = io.BytesIO()
        np.lib.format.write_array(packed, block, allow_pickle=False)
        try:
            self._file.write(packed.getvalue())
        except RecordingFailed as failed:
            self._failed = True
            raise failed.after(self.rows, "convert --unfinished") from None

    def close(self) -> None:
        """See RowWriter."""
        if self._closed:
            return
        self._closed = True
        try:
            if self._failed:
                return
            self._file.require_there(self.rows)
        finally:
            self._file.close()
        with self._path.open("rb") as file:
            names, notes, blocks = read_blocks(file)
        whole = np.concatenate(blocks) if blocks else np.empty((0, len(names)))
        columns = {name: whole[:, j] for j, name in enumerate(names)}
        notes.pop("", None)
        write_recording(self._path, columns.pop(names[0]), columns, notes)
