"""Recordings as MCAP, which Foxglove and PlotJuggler open: one topic, one message per row, JSON
with its schema in the file. Numbers are written as Python prints them, so that reading returns the
same bits; a missing value is omitted from its message.

The schema uses only the type "number": Foxglove accepts no list of types, and only 32 bits of an
"integer". MCAP times are whole nanoseconds since an epoch: `started` from the notes, otherwise
1970.
"""

import json
import math
import struct
from array import array
from collections.abc import Mapping, Sequence
from datetime import datetime
from pathlib import Path
from typing import IO, Any, BinaryIO, cast

import numpy as np
from numpy.typing import NDArray

from dehyst import __version__
from dehyst.daemon.files.appended import AppendedFile, RecordingFailed
from dehyst.daemon.files.number_text import number_texts
from dehyst.daemon.files.unfinished import not_finished
from dehyst.models.errors import BadRecording
from dehyst.models.recording import Floats

TOPIC, NOTES, NAME = "/dehyst/recording", "dehyst", "dehyst.Recording"
NS = 1_000_000_000
MOST_ROWS, MOST_RECORD_BYTES = 20_000_000, 256 << 20
CHUNK_BYTES, BLOCK_ROWS = 256 << 10, 65_536
HELD_S = 2.0
"""Longest recorded time in rows that are not yet in the file."""
MAGIC = b"\x89MCAP0\r\n"


class McapRows:
    """A recording that grows in chunks: see dehyst.daemon.files.rows.RowWriter.

    file: receives the bytes; names: of the columns, `t_s` first; notes: stored in the file's
    metadata.
    """

    full = False

    def __init__(
        self,
        file: AppendedFile | BinaryIO,
        names: Sequence[str],
        notes: Mapping[str, str],
    ) -> None:
        from mcap.writer import Writer  # imported here: only MCAP files need it

        self.rows = self._in_file = 0
        self._file, self._failed = file, False
        self._held_from_s = 0.0
        self._begun_ns = _start_ns(notes)
        self._names = [json.dumps(name) + ":" for name in names]
        self._writer = Writer(cast("IO[Any]", file), chunk_size=CHUNK_BYTES)
        self._writer.start(profile="", library=f"dehyst {__version__}")
        schema = json.dumps(_schema(names)).encode()
        number = self._writer.register_schema(NAME, "jsonschema", schema)
        self._channel = self._writer.register_channel(TOPIC, "json", number)
        if notes:
            flat = {key: str(value) for key, value in notes.items()}
            self._writer.add_metadata(NOTES, flat)

    @property
    def size(self) -> int:
        """Bytes written so far."""
        return self._file.tell()

    def add(self, columns: Sequence[NDArray[Any]]) -> None:
        """Append (n,) values of each column. Raises RecordingFailed."""
        at_ns = self._begun_ns + np.round(np.asarray(columns[0], float) * NS).astype(np.int64)
        fields = [
            [name + text if text else "" for text in number_texts(column, "", finite=True)]
            for name, column in zip(self._names, columns, strict=True)
        ]
        size, add = self._file.tell(), self._writer.add_message
        times = columns[0]
        if len(times) and self.rows == self._in_file:
            self._held_from_s = float(times[0])
        try:
            for time_ns, row in zip(at_ns.tolist(), zip(*fields, strict=True), strict=True):
                message = "{" + ",".join(filter(None, row)) + "}"
                add(self._channel, time_ns, message.encode(), time_ns, self.rows & 0xFFFFFFFF)
                self.rows += 1
                if self._file.tell() != size:  # a chunk was completed with this row
                    size, self._in_file = self._file.tell(), self.rows
                    self._held_from_s = time_ns / NS - self._begun_ns / NS
            if len(times) and float(times[-1]) - self._held_from_s >= HELD_S:
                self._writer.flush()
                self._in_file = self.rows
        except RecordingFailed as failed:
            self._failed, self.rows = True, self._in_file
            raise failed.after(self.rows, "convert --unfinished") from None

    def finish(self) -> None:
        """Write the last chunk and the index; the file stays open. Raises RecordingFailed."""
        if not self._failed:
            self._failed = True  # never finish twice, whatever happens
            try:
                self._writer.finish()
            except RecordingFailed as failed:
                self.rows = self._in_file
                raise failed.after(self.rows, "convert --unfinished") from None

    def close(self) -> None:
        """Finish and close the file."""
        try:
            self.finish()
            if isinstance(self._file, AppendedFile):
                self._file.require_there(self.rows)
        finally:
            self._file.close()


def write_mcap(file: BinaryIO, table: Mapping[str, Any], notes: Mapping[str, str]) -> None:
    """Write columns (name with unit -> (N,) values, `t_s` first) and notes into an open file."""
    rows = McapRows(file, list(table), notes)
    columns = [np.asarray(column) for column in table.values()]
    for start in range(0, columns[0].size, BLOCK_ROWS):
        rows.add([column[start : start + BLOCK_ROWS] for column in columns])
    rows.finish()


def _schema(names: Sequence[str]) -> dict[str, Any]:
    """Return the row's schema: every column is a number."""
    kinds = {name: {"type": "number", "description": name} for name in names}
    return {"title": NAME, "type": "object", "properties": kinds}


def _start_ns(notes: Mapping[str, str]) -> int:
    try:
        return max(0, round(datetime.fromisoformat(notes["started"]).timestamp() * NS))
    except (KeyError, ValueError):
        return 0


def read_mcap(path: Path, unfinished: bool = False) -> tuple[dict[str, Floats], dict[str, str]]:
    """Return (columns by name, notes) of the one topic of JSON numbers in a file. If the messages
    hold no `t_s`, it is the log time, counted from the first message. unfinished: read the complete
    part of a file whose writer did not finish. Raises BadRecording naming file and remedy."""
    from mcap.exceptions import McapError
    from zstandard import ZstdError

    columns: dict[str, array[float]] = {}
    times: list[int] = []
    notes: dict[str, str] = {}
    try:
        _read_messages(path, columns, times, notes, unfinished)
    except BadRecording:
        raise
    except OSError as error:
        raise BadRecording(f"{path}: cannot be read: {error.strerror or error}") from None
    # a damaged file raises different exceptions in the library, its decompressors and JSON
    except (
        McapError,
        ZstdError,
        struct.error,
        ValueError,
        KeyError,
        EOFError,
        RuntimeError,
        OverflowError,
        MemoryError,
    ):
        if not (unfinished and times):
            raise BadRecording(
                f"{path}: not an MCAP file that can be read: it is cut short or damaged"
            ) from None
    arrays = {name: np.array(values, dtype=np.float64) for name, values in columns.items()}
    if times and "t_s" not in arrays:
        arrays = {"t_s": (np.array(times) - times[0]) / NS, **arrays}
    return arrays, notes


def _read_messages(
    path: Path,
    columns: dict[str, "array[float]"],
    times: list[int],
    notes: dict[str, str],
    unfinished: bool,
) -> None:
    """Fill columns, times and notes from the file, in the file's order."""
    from mcap.reader import NonSeekingReader, SeekingReader
    from mcap.records import Message, Metadata
    from mcap.stream_reader import StreamReader

    limits: dict[str, Any] = {"validate_crcs": True, "record_size_limit": MOST_RECORD_BYTES}
    with path.open("rb") as file:
        _require_end(path, file, unfinished)
        if unfinished:
            for record in StreamReader(file, **limits).records:
                if isinstance(record, Metadata):
                    notes.update(record.metadata)
                elif isinstance(record, Message):  # the notes come first
                    break
            file.seek(0)
            messages = NonSeekingReader(file, **limits).iter_messages(log_time_order=False)
        else:
            reader = SeekingReader(file, **limits)
            notes.update({k: v for m in reader.iter_metadata() for k, v in m.metadata.items()})
            messages = reader.iter_messages()
        topic = ""
        for schema, channel, message in messages:
            if topic not in ("", channel.topic):
                both = ", ".join(repr(one[:80]) for one in sorted((topic, channel.topic)))
                raise BadRecording(
                    f"{path.name}: holds several topics ({both}); one with the columns of a "
                    "recording is needed"
                )
            if channel.message_encoding != "json":
                raise BadRecording(
                    f"{path.name}: {channel.topic[:80]!r} is encoded as "
                    f"{channel.message_encoding[:40]!r}; JSON is read"
                )
            if not topic and schema is not None and schema.name == NAME:
                for name in json.loads(schema.data)["properties"]:
                    columns[name] = array("d")
            topic = channel.topic
            _append(path, columns, json.loads(message.data), len(times))
            times.append(message.log_time)
            if len(times) > MOST_ROWS:
                raise BadRecording(f"{path.name}: more than {MOST_ROWS} rows")


def _require_end(path: Path, file: BinaryIO, unfinished: bool) -> None:
    """Raise BadRecording if the file begins like an MCAP file but does not end like one."""
    begins = file.read(len(MAGIC)) == MAGIC
    file.seek(max(0, path.stat().st_size - len(MAGIC)))
    ends = file.read() == MAGIC
    file.seek(0)
    if begins and not ends and not unfinished:
        raise not_finished(path)


def _append(path: Path, columns: dict[str, "array[float]"], row: Any, number: int) -> None:
    if not isinstance(row, dict):
        raise BadRecording(f"{path.name}: message {number} is not a row of named numbers")
    for name in row:
        if name not in columns:
            columns[name] = array("d", [math.nan]) * number
    for name, values in columns.items():
        value = row.get(name)
        if value is not None and not isinstance(value, int | float):
            raise BadRecording(f"{path.name}: message {number}: {name} is not a number")
        values.append(math.nan if value is None else float(value))
