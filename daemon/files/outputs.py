"""Write results without destroying any of the user's files.

An output never replaces an input, under any name or link; a result of an earlier run (a model, a
report, a picture) is replaced, any other existing file only if the user asked for that; only
ordinary files are written to. A file appears complete or not at all: it is written under a
temporary name, flushed to disk, and then renamed.
"""

import argparse
import os
import secrets
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import BinaryIO

from dehyst.drivers import system
from dehyst.models.errors import BadInput, DehystError

RESULTS = (".html", ".png", ".json", ".md")
"""Suffixes of results, which a later run replaces, except the files named in STATE."""
STATE = {"setup.json", "units.json"}
"""Files of these names hold what a set-up did and which devices are known."""
MODEL_TABLE, HEAD_BYTES = b"[hysteresis]", 4096
"""What a model file holds near its beginning, and how much of it is looked at."""
WITH_NOTES = (".csv", ".csv.gz")


def notes_path(path: Path) -> Path:
    """Return the path of a recording's notes."""
    return path.with_name(f"{path.name}.meta.json")


def _is_result(path: Path) -> bool:
    """Return whether an existing file is a result that dehyst wrote: a model, a report or a
    picture."""
    if path.suffix.lower() == ".toml" and path.is_file():
        with path.open("rb") as file:
            return MODEL_TABLE in file.read(HEAD_BYTES)
    return path.name.lower().endswith(RESULTS) and path.name not in STATE


def add_force(parser: argparse.ArgumentParser) -> None:
    """Add the --force option."""
    parser.add_argument(
        "--force", action="store_true", help="replace existing files (never an input)"
    )


def check_outputs(
    outputs: Iterable[str | Path | None], inputs: Iterable[str | Path | None], force: bool
) -> None:
    """Raise BadInput if writing would destroy something. A path of None is an option that was not
    given."""
    read = [Path(path) for path in inputs if path]
    read += [notes_path(path) for path in read]
    written: list[Path] = []
    for output in outputs:
        if not output:
            continue
        path = Path(output)
        for other in read:
            if _same(path, other):
                raise BadInput(f"{path}: is an input ({other}); choose another name for the output")
        if any(_same(path, other) for other in written):
            raise BadInput(f"{path}: two outputs would go to this file; choose two names")
        check_place(path)
        notes = notes_path(path)
        if not force and path.exists() and not _is_result(path):
            raise BadInput(f"{path}: exists already; choose another name, or --force replaces it")
        if not force and notes.exists() and path.name.lower().endswith(WITH_NOTES):
            raise BadInput(
                f"{notes}: exists already, and the notes of {path.name} are written there; choose "
                "another name, or --force replaces it"
            )
        written.append(path)


def check_place(path: Path) -> None:
    """Raise BadInput if the path exists but is not an ordinary file, or if what should be a folder
    above it is a file."""
    if blocking := next((p for p in path.parents if p.exists() and not p.is_dir()), None):
        raise BadInput(f"{blocking}: is a file, not a folder")
    if path.exists() and not path.is_file():
        raise BadInput(f"{path}: cannot be written: it is not an ordinary file")


def _same(path: Path, other: Path) -> bool:
    try:
        return os.path.samefile(path, other)
    except OSError:  # one of them does not exist yet
        return path.resolve() == other.resolve()


@contextmanager
def report_failures(path: str | Path, kind: type[DehystError] = BadInput) -> Iterator[None]:
    """Raise `kind`, which names the file and the reason, if it cannot be written."""
    try:
        yield
    except OSError as error:
        raise kind(f"{path}: cannot be written: {error.strerror or error}") from None


@contextmanager
def whole_file(path: str | Path) -> Iterator[BinaryIO]:
    """Open a file for writing bytes; it gets its name when it is complete. Raises OSError, and then
    leaves nothing on disk."""
    path = Path(path)
    check_place(path)
    part = path.with_name(f".{path.name[:200]}.{secrets.token_hex(6)}.part")
    flags = os.O_WRONLY | os.O_CREAT | os.O_EXCL | system.NO_FOLLOW | system.CLOSE_ON_EXEC
    handle = os.open(part, flags, 0o666)
    try:
        with open(handle, "wb") as file:
            yield file
            file.flush()
            os.fsync(file.fileno())
        os.replace(part, path)
        system.sync_folder(path.parent)
    except BaseException:
        part.unlink(missing_ok=True)
        raise


def file_of_axis(path: Path, axis: str) -> Path:
    """Return the file name for one of several axes: scan.json, scan-x.json."""
    if not axis:
        return path
    head, dot, suffix = path.name.partition(".")
    return path.with_name(f"{head}-{axis}{dot}{suffix}")
