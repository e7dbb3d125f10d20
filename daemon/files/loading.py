"""Load the columns of a file of any kind, under the names that recordings use.

A file in dehyst's own format is read as it is; a file of another program is interpreted first (see
dehyst.daemon.files.foreign), and the interpretation is reported.
"""

import gzip
import re
import tempfile
import zlib
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, BinaryIO, cast

import numpy as np

from dehyst.daemon.files.axis_columns import is_axis_column
from dehyst.daemon.files.csv_table import (
    LARGEST,
    LONGEST_LINE,
    line_of_row,
    read_table,
)
from dehyst.daemon.files.foreign.containers.apart import NEEDS, read_apart
from dehyst.daemon.files.foreign.containers.arrays import found_in, of_one_length
from dehyst.daemon.files.foreign.containers.numpy_file import read_npy, read_npz
from dehyst.daemon.files.foreign.containers.packed import PACKED, kind_of_zip, unpack
from dehyst.daemon.files.foreign.fields import TRUTHS, number_of
from dehyst.daemon.files.foreign.found import Column, Given, Sheet
from dehyst.daemon.files.foreign.no_value import (
    MOST_MISSING,
    note_marked,
    note_wrapped,
    stands_for_none,
)
from dehyst.daemon.files.foreign.reading import AS_IT_IS, ReadOptions
from dehyst.daemon.files.foreign.roles import BY_UNIT, PLAIN, role_of
from dehyst.daemon.files.foreign.text import ends_in_other_rows, read_text_table
from dehyst.daemon.files.foreign.understand import understand
from dehyst.daemon.files.mcap_file import read_mcap
from dehyst.daemon.files.sidecar import read_notes
from dehyst.daemon.files.unfinished import read_whole_part
from dehyst.daemon.printable import printable
from dehyst.models.errors import BadRecording
from dehyst.models.recording import Bools, Floats
from dehyst.models.units import how_many

TEXTS = (".csv", ".csv.gz", ".txt", ".dat", ".tsv", ".lvm", ".asc", ".prn", ".ecsv", ".log")
SUFFIXES = (*TEXTS, ".npz", ".npy", ".mcap", *NEEDS, *PACKED)
ARCHIVES = (".tar", ".tgz", ".7z", ".rar")
UNDERSTOOD = ("t", "u")
BEGINS = {
    b"PK\x03\x04": ".zip", b"\x89HDF": ".h5", b"TDSm": ".tdms", b"PAR1": ".parquet",
    b"\x93NUMPY": ".npy", b"MATLAB ": ".mat", b"\x89MCAP": ".mcap", b"\x1f\x8b": ".gz",
    b"BZh": ".bz2", b"\xfd7zXZ": ".xz", b"ARROW1": ".feather", b"FEA1": ".feather",
    b"CDF": ".nc",
}  # fmt: skip
"""First bytes of each kind of file that is not text, and its suffix."""


@dataclass
class Loaded:
    """columns: by name, each (N,); notes: from the file; said: how the file was interpreted, "" for
    a file in dehyst's own format; seconds: whether `t_s` is certainly in seconds; where: describes
    the place of a row."""

    columns: dict[str, Floats]
    notes: dict[str, str]
    said: str = ""
    seconds: bool = False
    where: Callable[[int], str] = field(default=lambda row: f"sample {row}")


@np.errstate(all="ignore")  # damaged numbers overflow; these warnings must not reach the screen
def load_columns(
    path: Path,
    reading: ReadOptions = AS_IT_IS,
    unfinished: bool = False,
    wants: Sequence[str] = UNDERSTOOD,
) -> Loaded:
    """Return all columns of a file. unfinished: read the complete part of a file whose writer was
    killed or found the disk full; wants: which of t, u, y, target must be found in a file of
    another program. Raises BadRecording with a one-line message."""
    name = path.name
    if len(name) > 255 or len(str(path)) > 4095:
        raise BadRecording(f"{name[:60]}...: the name is too long for a file")
    if path.is_dir():
        raise BadRecording(f"{path}: is a directory, not a recording")
    if not path.exists():
        raise BadRecording(f"{path}: no such file")
    if not path.is_file():
        raise BadRecording(f"{path}: is not an ordinary file")
    if not name.lower().endswith(SUFFIXES):
        raise BadRecording(
            f"{name}: unknown kind of file; {_remedy_for(path)}; {', '.join(SUFFIXES)} are read"
        )
    kind = path.suffix.lower()
    _refuse_wrong_suffix(path)
    if kind in PACKED and not name.lower().endswith(".csv.gz"):
        return _load_packed(path, reading, wants)
    if unfinished:
        read = read_whole_part(path) if kind != ".mcap" else None
        loaded = Loaded(*read) if read is not None else _load_mcap(path, reading, True, wants)
    elif kind == ".mcap":
        loaded = _load_mcap(path, reading, False, wants)
    elif kind in NEEDS:
        loaded = _understood(path, read_apart(path), reading, wants)
    elif kind == ".npz":
        loaded = _load_npz(path, reading, wants)
    elif kind == ".npy":
        loaded = _understood(path, read_npy(path), reading, wants)
    elif not reading and name.lower().endswith((".csv", ".csv.gz")) and _is_own(path, wants):
        loaded = _load_own(path, wants)
    else:
        loaded = _understood(path, read_text_table(path), reading, wants)
        loaded.notes |= read_notes(path)
    if not loaded.columns:
        raise BadRecording(f"{name}: the file holds no columns")
    if not loaded.said:  # in dehyst's own form, which is read to the bit
        found = [_no_values(key, values)[1] for key, values in loaded.columns.items()]
        remarks = [
            f"{text} may stand for no value; if so, empty these fields" for text in found if text
        ]
        loaded.said = "; ".join(remarks)
    if wrapped := note_wrapped(loaded.columns):
        loaded.said = f"{loaded.said}; {wrapped}".removeprefix("; ")
    return loaded


def _load_own(path: Path, wants: Sequence[str]) -> Loaded:
    """Load a CSV in dehyst's own form, without sums and notes below its numbers."""
    own = read_notes(path)  # of a recording that dehyst wrote, whose times are in seconds
    try:
        table = read_table(path)
    except BadRecording:
        if not ends_in_other_rows(path):
            raise
        return _understood(path, read_text_table(path), AS_IT_IS, wants)
    loaded = Loaded(table.columns, {**table.metadata, **own}, seconds=bool(own))
    loaded.where = lambda row: f"line {line_of_row(path, row)}"
    return loaded


def _no_values(name: str, values: Floats) -> tuple[Bools, str]:
    """Return (which values of a column stand for no value, words for them or "")."""
    none, words = stands_for_none(values, name == "t_s")
    rows = how_many(int(np.count_nonzero(none)), "row")
    return none, f"{words} in {rows} of {name[:40] or 'a column'}" if words else ""


def _load_packed(path: Path, reading: ReadOptions, wants: Sequence[str]) -> Loaded:
    """Load the file inside a packed one; its own name or its content shows its kind."""
    with tempfile.TemporaryDirectory(prefix="dehyst-read-") as folder:
        inner = unpack(path, Path(folder))
        if not inner.name.lower().endswith(SUFFIXES):
            kind, text = _content_of(inner)
            inner = inner.rename(f"{inner}{kind or ('.txt' if text else '')}")
        try:
            loaded = load_columns(inner, reading, wants=wants)
        except BadRecording as error:
            said = str(error).replace(str(inner), path.name).replace(inner.name, path.name)
            raise BadRecording(said) from None
    loaded.where = lambda row: f"row {row + 1}"
    return loaded


def _remedy_for(path: Path) -> str:
    """Return how a file of unknown kind becomes one that is read."""
    kind, text = _content_of(path)
    if path.suffix.lower() in ARCHIVES:
        return "unpack it, and name the recordings in it"
    with path.open("rb") as file:
        marked = text and file.read(1) == b"<"
    if marked:
        return "it holds HTML or XML: save it as .csv or .xlsx in a spreadsheet program"
    if kind or text:
        return f"it begins like {'text' if text else f'a {kind} file'}: rename it to " + (
            kind or ".txt"
        )
    return "save it as .csv or .xlsx in the program that wrote it"


def _content_of(path: Path) -> tuple[str, bool]:
    """Return (suffix of the kind that a file begins like, or ""; whether it begins like text)."""
    try:
        with path.open("rb") as file:
            head = file.read(512)
    except OSError:  # whoever reads it says why
        return "", False
    marks = (b"\xff\xfe", b"\xfe\xff", b"\xef\xbb\xbf")
    kind = next((suffix for begin, suffix in BEGINS.items() if head.startswith(begin)), "")
    if kind == ".zip":
        return kind_of_zip(path), False
    plain = bool(head) and all(byte in b"\t\r\n" or byte >= 32 for byte in head)
    return kind, not kind and (plain or head.startswith(marks))


def _refuse_wrong_suffix(path: Path) -> None:
    """Raise BadRecording naming the right suffix if a file begins like one of another kind."""
    kind = path.suffix.lower()
    right, text = _content_of(path)
    if right and kind in TEXTS:
        name = f"{path.name}{right}" if right in PACKED else f"{path.stem}{right}"
        raise BadRecording(
            f"{path.name}: is not text, but begins like a {right} file: rename it to {name}"
        )
    if text and kind in {*NEEDS, ".npy", ".npz"} - {".json", ".jsonl"}:
        what = NEEDS[kind][0] if kind in NEEDS else f"an {kind} file"
        raise BadRecording(f"{path.name}: not {what} but text: rename it to .txt")


def _is_own(path: Path, wants: Sequence[str]) -> bool:
    """Return whether a CSV begins as dehyst writes it: a comma-separated header with the wanted
    columns under their own names, and as many numbers in the next line. A file that cannot be read
    counts as own, so that read_table reports the reason."""
    try:
        opener = gzip.open if path.suffix.lower() == ".gz" else open
        with opener(path, "rb") as file:
            lines = _first_lines(cast(BinaryIO, file))
    except (OSError, EOFError, ValueError, zlib.error):
        return True
    if not lines:
        return True
    header = [cell.strip().strip('"') for cell in lines[0].split(",")]
    if not _names_are_own(header, wants) or not all(header) or "\r" in lines[0].rstrip("\r"):
        return False
    if len(lines) < 2:
        return True
    fields = lines[1].partition("#")[0].split(",")
    numbers = [number_of(field) is not None for field in fields]
    truths = any(field.strip().lower() in TRUTHS for field in fields)
    return len(fields) == len(header) and all(numbers) and not truths


def _names_are_own(names: Iterable[str], wants: Sequence[str]) -> bool:
    """Return whether the wanted columns have dehyst's own names, and no other column is the drive,
    displacement or target that is not there under such a name."""
    roles = {name: role_of(name, "") for name in names}
    found = {role for role, sure in roles.values() if sure == PLAIN}
    return found.issuperset(wants) and not any(
        role and role not in found and not _is_channel(name, sure)
        for name, (role, sure) in roles.items()
    )


def _is_channel(name: str, sure: int) -> bool:
    """Return whether a recording may use this name for a further channel: `trim_um`, `u2_v`."""
    plain = re.fullmatch(r"[a-z][a-z0-9_]*", name) is not None
    return is_axis_column(name) or (plain and (sure == BY_UNIT or bool(re.search(r"\d", name))))


def _first_lines(file: BinaryIO) -> list[str]:
    """Return the header and the line after it."""
    out: list[str] = []
    for _ in range(1000):
        raw = file.readline(LONGEST_LINE)
        text = raw.decode("latin-1").removeprefix("ï»¿").strip("\n")
        if not raw:
            break
        if text.strip() and not text.lstrip().startswith("#"):
            out.append(text)
            if len(out) == 2:
                break
    return out


def understand_columns(
    name: str, arrays: Mapping[str, Any], reading: ReadOptions, wants: Sequence[str]
) -> Loaded:
    """Interpret columns that are already in memory, by name."""
    if not reading and _names_are_own(arrays, ("t",)):
        return Loaded(plain_columns(name, arrays), {})
    found = found_in((Given(key, _numbers(values)) for key, values in arrays.items()), {})
    return _understood(Path(name), found, reading, wants)


def _numbers(values: Any) -> Any:
    return values.to_numpy() if hasattr(values, "to_numpy") else values


def _understood(path: Path, found: Sheet, reading: ReadOptions, wants: Sequence[str]) -> Loaded:
    for column in found.columns:  # shown in messages, and given to --columns as shown
        column.heading, column.unit = printable(column.heading), printable(column.unit)
        column.values = _finite(column.values)
        none, words = _no_values(column.heading, column.values)
        if words:
            column.values = np.where(none, np.nan, column.values)
            found.said.append(f"{words} taken for no value")
    found.said = [printable(text) for text in [*found.said, *note_marked(found.columns)]]
    needs = [role for role in wants if role not in reading.columns]
    found = of_one_length(path.name, found, map(str, reading.columns.values()), needs)
    _refuse_absurd(path.name, {c.heading: c.values for c in found.columns})
    try:
        read = understand(path.name, found, reading, wants)
    except BadRecording as error:
        left = [text for text in found.said if "left out" in text or "taken for sep" in text]
        raise BadRecording("; ".join([str(error), *left])) from None
    return Loaded(read.columns, found.notes, read.said, read.seconds, found.where)


def _finite(values: Any) -> Any:
    """Return the values with NaN for infinity, which programs write beyond an instrument's range
    and for a division by zero; what is missing is counted and reported."""
    values = np.asarray(values, dtype=np.float64)
    return np.where(np.isinf(values), np.nan, values) if np.any(np.isinf(values)) else values


def _load_npz(path: Path, reading: ReadOptions, wants: Sequence[str]) -> Loaded:
    arrays, left = read_npz(path)
    notes = {k[1:]: str(v) for k, v in arrays.items() if k.startswith("#")}
    arrays = {k: v for k, v in arrays.items() if k[:1] != "#"}
    numbers = all(v.dtype.kind in "biuf" for v in arrays.values())
    one_length = len({v.size for v in arrays.values()}) == 1
    own = numbers and one_length and not left and _names_are_own(arrays, wants)
    if own and not reading:
        return Loaded(plain_columns(path.name, arrays), notes)
    found = found_in((Given(key, values) for key, values in arrays.items()), notes)
    if left:
        found.said.append(
            f"with Python objects and left out: {', '.join(left[:5])}: save their arrays one by one"
        )
    return _understood(path, found, reading, wants)


def _load_mcap(path: Path, reading: ReadOptions, unfinished: bool, wants: Sequence[str]) -> Loaded:
    columns, notes = read_mcap(path, unfinished)
    known = any(name[:2] in ("u_", "y_") or name[:7] == "target_" for name in columns)
    if known and not reading and _names_are_own(columns, ()):
        return Loaded(plain_columns(path.name, columns), notes)
    found = Sheet([Column(name, values) for name, values in columns.items()], notes)
    return _understood(path, found, reading, wants) if columns else Loaded({}, notes)


def plain_columns(name: str, arrays: Mapping[str, Any]) -> dict[str, Floats]:
    """Return arrays of numbers as columns of equal length. Raises BadRecording."""
    columns: dict[str, Floats] = {}
    for given, values in arrays.items():
        key = printable(given)
        if key in columns:
            raise BadRecording(f"{name}: two columns are named {key[:60]}")
        try:
            columns[key] = np.ascontiguousarray(values, dtype=np.float64).reshape(-1)
        except (TypeError, ValueError, MemoryError):
            raise BadRecording(f"{name}: {key} does not hold numbers") from None
    _refuse_absurd(name, columns)
    sizes = {key: values.size for key, values in columns.items()}
    if len(set(sizes.values())) > 1:
        raise BadRecording(f"{name}: columns of unequal length: {sizes}")
    return columns


def _refuse_absurd(name: str, columns: Mapping[str, Floats]) -> None:
    for key, values in columns.items():
        known = np.isfinite(values)
        absurd = np.count_nonzero(np.abs(values[known]) > LARGEST)
        if absurd > MOST_MISSING * np.count_nonzero(known):
            raise BadRecording(f"{name}: {key[:60]} holds numbers beyond any measurement")
