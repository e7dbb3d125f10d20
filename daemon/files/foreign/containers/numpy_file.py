"""Read NumPy's files, .npy and .npz, without loading Python objects."""

import warnings
import zipfile
from collections.abc import Callable
from pathlib import Path
from typing import Any, cast

import numpy as np

from dehyst.daemon.files.csv_table import MOST_BYTES
from dehyst.daemon.files.foreign.containers.apart import DAMAGED
from dehyst.daemon.files.foreign.containers.arrays import found_in
from dehyst.daemon.files.foreign.found import Given, Sheet
from dehyst.daemon.files.unfinished import is_unfinished_npz, not_finished
from dehyst.models.errors import BadRecording


def read_npy(path: Path) -> Sheet:
    """Return the columns of one array. Raises BadRecording."""
    if path.stat().st_size > MOST_BYTES:
        raise BadRecording(f"{path.name}: more than {MOST_BYTES >> 20} MB; cut it into pieces")
    array = _carefully(path, ".npy", lambda: np.load(path, allow_pickle=False, mmap_mode="r"))
    if 8 * array.size > MOST_BYTES:
        raise BadRecording(f"{path.name}: more than {MOST_BYTES >> 20} MB; cut it into pieces")
    return found_in([Given("", np.array(array))], {})


def read_npz(path: Path) -> tuple[dict[str, Any], list[str]]:
    """Return the arrays by name, and the names of those that hold Python objects. Raises
    BadRecording."""
    if is_unfinished_npz(path):
        raise not_finished(path)
    if not zipfile.is_zipfile(path):
        raise BadRecording(f"{path.name}: not an .npz file")

    def read() -> tuple[dict[str, Any], list[str]]:
        with zipfile.ZipFile(path) as members:
            size = sum(member.file_size for member in members.infolist())
        if size > MOST_BYTES:
            raise BadRecording(
                f"{path}: unpacks to {size >> 20} MB; at most {MOST_BYTES >> 20} MB "
                "are read; cut it into several files"
            )
        arrays, left = {}, []
        with np.load(path, allow_pickle=False) as data:
            for key in data.files:
                try:
                    array = data[key]
                except ValueError as error:
                    if "allow_pickle" not in str(error):
                        raise
                    left.append(key)
                    continue
                if isinstance(array, np.ndarray):
                    arrays[key] = array
        return arrays, left

    return cast(tuple[dict[str, Any], list[str]], _carefully(path, ".npz", read))


def _carefully(path: Path, kind: str, read: Callable[[], Any]) -> Any:
    """Call a numpy reader and turn every failure into BadRecording: a damaged file raises different
    exceptions in numpy, zipfile, zlib, ast and tokenize, and causes warnings."""
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            return read()
    except BadRecording:
        raise
    except Exception as error:
        why = (isinstance(error, OSError) and error.errno and error.strerror) or DAMAGED
        if "Python objects" in str(error):
            why = "it holds Python objects; save their arrays by numpy.savez(FILE, t=..., u=...)"
        raise BadRecording(f"{path}: not an {kind} file that can be read: {why}") from None
