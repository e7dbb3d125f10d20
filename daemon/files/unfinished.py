"""Recover the complete part of a recording whose writer was killed or found the disk full.

.csv     up to the end of the last complete line, before the first zero byte
.csv.gz  everything that can be unpacked, up to the end of its last complete line
.npz     the complete blocks of a file that was never finished (see rows.NpzRows); of a damaged
         archive, nothing
.mcap    the complete chunks: see mcap_file
"""

import io
import shlex
import zlib
from pathlib import Path
from typing import Any, BinaryIO

import numpy as np

from dehyst.daemon.files.csv_table import MOST_BYTES, read_lines
from dehyst.daemon.files.sidecar import read_notes
from dehyst.models.errors import BadRecording
from dehyst.models.recording import Floats

BLOCK = 1 << 20
NPZ_BLOCK = b"\x93NUMPY"


def not_finished(path: Path) -> BadRecording:
    """Return the error for a recording whose writer did not finish."""
    return BadRecording(
        f"{path.name}: its writer did not finish (it was killed, or the disk was full); "
        f"dehyst convert --unfinished {shlex.quote(path.name)} whole{path.suffix.lower()} recovers "
        "the complete part"
    )


def is_unfinished_npz(path: Path) -> bool:
    """Return whether a file consists of the blocks of an unfinished .npz."""
    with path.open("rb") as file:
        return file.read(len(NPZ_BLOCK)) == NPZ_BLOCK


def read_whole_part(path: Path) -> tuple[dict[str, Floats], dict[str, str]]:
    """Return (columns, notes) of the complete part. Raises BadRecording if there is none."""
    kind = path.suffix.lower()
    try:
        if kind == ".npz":
            return _of_npz(path)
        if kind in (".gz", ".csv"):
            text = _unpack(path) if kind == ".gz" else path.read_bytes()
            return _of_text(path, text)
    except OSError as error:
        raise BadRecording(f"{path}: cannot be read: {error.strerror or error}") from None
    raise BadRecording(
        f"{path.name}: dehyst writes no {kind}, so that it cannot be one of its unfinished "
        "recordings; read it as it is"
    )


def _of_text(path: Path, data: bytes) -> tuple[dict[str, Floats], dict[str, str]]:
    data = data.partition(b"\0")[0]
    data = data[: data.rfind(b"\n") + 1]
    if data.count(b"\n") < 2:
        raise BadRecording(f"{path.name}: it contains no complete row")
    table = read_lines(path.name, io.BytesIO(data))
    return dict(table.columns), {**table.metadata, **read_notes(path)}


def _unpack(path: Path) -> bytes:
    """Return everything that can be unpacked, member by member."""
    parts: list[bytes] = []
    size = 0
    with path.open("rb") as file:
        unpacker, fed = zlib.decompressobj(31), b""
        while True:
            fed = fed or file.read(BLOCK)
            if not fed:
                return b"".join(parts)
            try:
                parts.append(unpacker.decompress(fed))
            except zlib.error:
                return b"".join(parts)
            size += len(parts[-1])
            if size > MOST_BYTES:
                raise BadRecording(f"{path.name}: unpacks to more than {MOST_BYTES >> 20} MB")
            fed = unpacker.unused_data
            if unpacker.eof:
                unpacker = zlib.decompressobj(31)


def read_blocks(file: BinaryIO) -> tuple[list[str], dict[str, str], list[Any]]:
    """Return (names, notes, complete blocks (n, k)) of an unfinished .npz."""
    names = [str(name) for name in np.lib.format.read_array(file, allow_pickle=False)]
    pairs = np.lib.format.read_array(file, allow_pickle=False).reshape(-1, 2)
    notes = {str(key): str(value) for key, value in pairs}
    blocks: list[Any] = []
    while True:
        try:
            block = np.lib.format.read_array(file, allow_pickle=False)
        except (ValueError, EOFError, OSError):
            return names, notes, blocks
        if block.ndim != 2 or block.shape[1] != len(names) or block.dtype != np.float64:
            return names, notes, blocks
        blocks.append(block)


def _of_npz(path: Path) -> tuple[dict[str, Floats], dict[str, str]]:
    if not is_unfinished_npz(path):
        raise BadRecording(
            f"{path.name}: it is complete, or not an unfinished recording; read it directly"
        )
    try:
        with path.open("rb") as file:
            names, notes, blocks = read_blocks(file)
    except Exception:  # numpy raises different exceptions on a damaged header
        raise BadRecording(
            f"{path.name}: not an .npz file that can be read: it is cut short or damaged"
        ) from None
    if not blocks:
        raise BadRecording(f"{path.name}: it contains no complete row")
    whole = np.concatenate(blocks)
    return {name: np.ascontiguousarray(whole[:, j]) for j, name in enumerate(names)}, notes
