"""Unpack a recording that is packed: .gz, .bz2, .xz, or a .zip that holds one file."""

import bz2
import gzip
import lzma
import zipfile
import zlib
from pathlib import Path, PurePosixPath
from typing import IO, Any

from dehyst.daemon.files.csv_table import MOST_PACKED, TRUSTED_BYTES
from dehyst.models.errors import BadRecording

PACKED = (".gz", ".bz2", ".xz", ".zip")
BLOCK_BYTES = 1 << 20
UNREADABLE = (
    OSError,
    EOFError,
    ValueError,
    RuntimeError,
    zlib.error,
    lzma.LZMAError,
    zipfile.BadZipFile,
)
"""What these libraries raise for damaged, encrypted or unsupported files; `RuntimeError` is also a
compression that this Python does not know."""


def unpack(path: Path, folder: Path) -> Path:
    """Write what a packed file holds into a folder, under its own name, and return its path. Raises
    BadRecording if it holds several files, cannot be unpacked, or unpacks to far more than numbers
    do."""
    try:
        if path.suffix.lower() == ".zip":
            with zipfile.ZipFile(path) as archive:
                member = _only_member(path.name, archive)
                name = path.stem + PurePosixPath(member).suffix
                with archive.open(member) as file:
                    return _copy(path, file, folder / name)
        openers: dict[str, Any] = {".gz": gzip.open, ".bz2": bz2.open, ".xz": lzma.open}
        with openers[path.suffix.lower()](path, "rb") as file:
            return _copy(path, file, folder / path.stem)
    except UNREADABLE as error:
        why = " ".join(str(error).split())[:200] or type(error).__name__
        raise BadRecording(f"{path}: cannot be unpacked: {why}") from None


def _only_member(name: str, archive: zipfile.ZipFile) -> str:
    """Return the name of the only file in an archive, apart from what systems add."""
    files = [
        one.filename
        for one in archive.infolist()
        if not one.is_dir() and not one.filename.startswith("__MACOSX/")
    ]
    if len(files) != 1:
        shown = [PurePosixPath(file).name for file in files[:3]]
        some = ", ".join([*shown, "..."] if len(files) > len(shown) else shown)
        raise BadRecording(
            f"{name}: holds {len(files)} files{f' ({some})' if files else ''}: unpack it, and name "
            "the recordings in it"
        )
    return files[0]


def kind_of_zip(path: Path) -> str:
    """Return the suffix of what an archive is: .xlsx, .npz, .zip, or "" for another program's."""
    try:
        with zipfile.ZipFile(path) as archive:
            names = archive.namelist()
    except UNREADABLE:
        return ".zip"
    if "mimetype" in names:  # a document of LibreOffice
        return ""
    if any(name.startswith("xl/") for name in names):
        return ".xlsx"
    return ".npz" if names and all(name.endswith(".npy") for name in names) else ".zip"


def _copy(path: Path, source: IO[bytes], target: Path) -> Path:
    left = max(TRUSTED_BYTES, MOST_PACKED * path.stat().st_size)
    with target.open("wb") as file:
        while block := source.read(BLOCK_BYTES):
            left -= len(block)
            if left < 0:
                raise BadRecording(
                    f"{path.name}: unpacks to more than {MOST_PACKED} times its size"
                )
            file.write(block)
    return target
