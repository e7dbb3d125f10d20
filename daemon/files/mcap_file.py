"""Recordings as MCAP, which Foxglove and PlotJuggler open: one topic, one message a row, JSON with
its schema in the file. Numbers are written as Python writes them, so that reading gives the same
bits; a missing value is null.

MCAP's times are whole nanoseconds since an epoch: the `started` of the notes, else 1970.
"""

import json
import math
import struct
from array import array
from collections.abc import Mapping
from datetime import datetime
from pathlib import Path
from typing import Any, BinaryIO

import numpy as np

from dehyst import __version__
from dehyst.models.errors import BadRecording
from dehyst.models.recording import Floats

TOPIC, NOTES, NAME = "/dehyst/recording", "dehyst", "dehyst.Recording"
NS = 1_000_000_000
MOST_ROWS, MOST_RECORD_BYTES = 20_000_000, 256 << 20


def write_mcap(file: BinaryIO, table: Mapping[str, Any], notes: Mapping[str, str]) -> None:
    """Columns (name with unit -> (N,) values, `t_s` among them) and notes into an open file."""
    from mcap.writer import Writer  # only who asks for such files waits for it

    writer = Writer(file)
    writer.start(profile="", library=f"dehyst {__version__}")
    schema = writer.register_schema(NAME, "jsonschema", json.dumps(_schema(table)).encode())
    channel = writer.register_channel(TOPIC, "json", schema)
    if notes:
        writer.add_metadata(NOTES, {key: str(value) for key, value in notes.items()})
    begun_ns = _start_ns(notes)
    names = list(table)
    at_ns = begun_ns + np.round(np.asarray(table["t_s"]) * NS).astype(np.int64)
    values = zip(*(np.asarray(column).tolist() for column in table.values()), strict=True)
    for number, (time_ns, row) in enumerate(zip(at_ns.tolist(), values, strict=True)):
        message = {k: _known(v) for k, v in zip(names, row, strict=True)}
        writer.add_message(channel, time_ns, json.dumps(message).encode(), time_ns, sequence=number)
    writer.finish()


def _known(value: Any) -> Any:
    return None if isinstance(value, float) and not math.isfinite(value) else value


def _schema(table: Mapping[str, Any]) -> dict[str, Any]:
    """The row's schema: every column is a number or null."""
    kinds = {name: {"type": ["number", "null"]} for name in table}
    return {"title": NAME, "type": "object", "properties": kinds}


def _start_ns(notes: Mapping[str, str]) -> int:
    try:
        return max(0, round(datetime.fromisoformat(notes["started"]).timestamp() * NS))
    except (KeyError, ValueError):
        return 0


def read_mcap(path: Path) -> tuple[dict[str, Floats], dict[str, str]]:
    """(columns by name, notes) of the one topic of JSON numbers in a file. Without `t_s` in the
    messages it is the log time, from the first one. Raises BadRecording naming file and remedy."""
    from mcap.exceptions import McapError
    from mcap.reader import SeekingReader
    from zstandard import ZstdError

    columns: dict[str, array[float]] = {}
    times: list[int] = []
    topics: set[str] = set()
    try:
        with path.open("rb") as file:
            reader = SeekingReader(file, validate_crcs=True, record_size_limit=MOST_RECORD_BYTES)
            notes = {k: v for m in reader.iter_metadata() for k, v in m.metadata.items()}
            for _, channel, message in reader.iter_messages():
                topics.add(channel.topic)
                if len(topics) > 1:
                    raise BadRecording(
                        f"{path.name}: holds several topics ({', '.join(sorted(topics))}); one "
                        "with the columns of a recording is needed"
                    )
                if channel.message_encoding != "json":
                    raise BadRecording(
                        f"{path.name}: {channel.topic} is encoded as {channel.message_encoding}; "
                        "JSON is read"
                    )
                _append(path, columns, json.loads(message.data), len(times))
                times.append(message.log_time)
                if len(times) > MOST_ROWS:
                    raise BadRecording(f"{path.name}: more than {MOST_ROWS} rows")
    except BadRecording:
        raise
    except OSError as error:
        raise BadRecording(f"{path}: cannot be read: {error.strerror or error}") from None
    # a damaged file breaks the library, its decompressors and the JSON in ways of their own
    except (
        McapError, ZstdError, struct.error, ValueError, KeyError, EOFError, RuntimeError,
        OverflowError, MemoryError,
    ) as error:  # fmt: skip
        why = f": {error}" if str(error) else ""
        raise BadRecording(f"{path}: not an MCAP file that can be read{why}") from None
    arrays = {name: np.array(values, dtype=np.float64) for name, values in columns.items()}
    if times and "t_s" not in arrays:
        arrays = {"t_s": (np.array(times) - times[0]) / NS, **arrays}
    return arrays, notes


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
