"""Read comma-separated numbers from a file in blocks: one header line, preceded by '#' lines as
notes.

numpy's C reader parses block by block, so memory holds the columns and one block. A block that it
refuses is read again line by line, which either replaces empty fields by NaN or names the faulty
line.
"""

import gzip
import io
import re
import shlex
import warnings
import zlib
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import BinaryIO, cast

import numpy as np

from dehyst.daemon.files.number_text import MOST_OTHERS, ends_inside_number
from dehyst.models.errors import BadRecording
from dehyst.models.recording import Floats

BLOCK_BYTES = 8 << 20
LONGEST_LINE = 1 << 16
MOST_BYTES = 512 << 20
"""Largest size of all columns in memory."""
MOST_NOTES = 1000
TRUSTED_BYTES, MOST_PACKED = 6 << 20, 60
"""Limits on unpacking: a text of numbers unpacks to five to thirty times its packed size."""
MOST_COLUMNS = 256
END_OF_FILE = "\x1a"
"""What DOS programs write after the last line (Ctrl-Z)."""
LARGEST = 1e15  # beyond this a number is damage, not a measurement; its cube still fits a float
_BEYOND_RANGE = (
    "over", "overflow", "over range", "overrange", "overload", "ovld", "ovrflw", "ol", "ovl", "ofl",
    "underflow", "under range", "underrange", "∞",
)  # fmt: skip
"""What instruments write, with or without a sign, for a value beyond their range."""
MISSING = {
    "", "nan", "-nan", "nan(ind)", "-nan(ind)", "nan(snan)", "-nan(snan)", "na", "n/a", "<na>",
    "nat", "null", "none", "nil", "-", "--", "---", "#n/a", "#nv", "#num!", "#zahl!", "#div/0!",
    "#value!", "#wert!", "#ref!", "#bezug!", "#name?", "#null!", "n.a.", "n.d.", "?",
    "missing", "undef", "no data", "nodata", "\\n", ".", "k.a.", "−∞",
    *(sign + word for sign in ("", "+", "-") for word in _BEYOND_RANGE),
}  # fmt: skip
"""Fields without a value."""
_NO_NUMBER = re.compile(r"[+-]?(1[.,]#\w+|9[.,]91?0*e\+?37)")
"""What Microsoft's C library writes for infinity and for what is not a number ("-1.#IND",
"1.#QNAN", "1.#INF"), and SCPI for a value that is not known or out of range ("9.91E+37",
"-9.9E+37")."""
_COMMENT = re.compile(r"(?m)(?:^|(?<=[ \t]))#.*")


@dataclass
class Table:
    """Columns by name, each (N,), and the notes of the '#' lines."""

    columns: dict[str, Floats]
    metadata: dict[str, str]


def read_table(path: Path) -> Table:
    """Return all columns of a .csv or .csv.gz. Raises BadRecording naming file, line and remedy."""
    opener = gzip.open if path.suffix.lower() == ".gz" else open
    try:
        with opener(path, "rb") as handle:
            packed = path.stat().st_size if opener is gzip.open else 0
            return _read(path.name, cast(BinaryIO, handle), packed)
    except (OSError, EOFError, zlib.error) as error:
        reason = getattr(error, "strerror", None) or error
        raise BadRecording(f"{path}: cannot be read: {reason}") from None


def read_lines(name: str, handle: BinaryIO) -> Table:
    """Return all columns of a CSV that is in memory. Raises BadRecording naming line and remedy."""
    return _read(name, handle, 0)


def _require_plausible_size(name: str, handle: BinaryIO, packed: int) -> None:
    """Check the unpacked size before anything is parsed, because parsing takes far longer."""
    left = max(TRUSTED_BYTES, MOST_PACKED * packed)
    while block := handle.read(BLOCK_BYTES):
        left -= len(block)
        if left < 0:
            raise BadRecording(f"{name}: unpacks to more than {MOST_PACKED} times its size")
    handle.seek(0)


def _read(name: str, handle: BinaryIO, packed: int) -> Table:
    if packed:
        _require_plausible_size(name, handle, packed)
    metadata, header, line = _header(name, handle)
    parts: list[list[Floats]] = [[] for _ in header]
    rows, before = 0, ""
    for first_line, text in _blocks(name, handle, line):
        if not text.endswith("\n") and _is_cut(text, before):
            raise _cut_short(name, f"line {first_line} ends inside a number")
        before = text
        block = _parse(name, header, text, first_line)
        rows += block.shape[0]
        if 8 * rows * len(header) > MOST_BYTES:
            raise BadRecording(f"{name}: more than {rows} rows; cut it into several files")
        for j, part in enumerate(parts):
            part.append(np.ascontiguousarray(block[:, j]))
    columns = {}
    for j, key in enumerate(header):  # one column at a time, so that memory holds only one twice
        columns[key] = np.concatenate(parts[j]) if parts[j] else np.empty(0)
        parts[j] = []
    return Table(columns, metadata)


def _header(name: str, handle: BinaryIO) -> tuple[dict[str, str], list[str], int]:
    metadata: dict[str, str] = {}
    line = 0
    while True:
        raw = handle.readline(LONGEST_LINE)
        line += 1
        if line > MOST_NOTES:
            raise BadRecording(f"{name}: no header line within the first {MOST_NOTES} lines")
        if not raw:
            what = "holds only notes, no header line" if line > 1 else "is empty"
            raise BadRecording(f"{name}: the file {what}")
        text = _decode(name, raw.removeprefix(b"\xef\xbb\xbf"), line).strip()
        if len(raw) == LONGEST_LINE:
            raise BadRecording(f"{name}: line {line} is too long for a CSV recording")
        if text.startswith("#"):
            note = text.lstrip("#").strip()
            for mark in (":", "="):
                key, found, value = note.partition(mark)
                if found and " " not in key.strip():
                    metadata[key.strip()] = value.strip()
                    break
            else:
                metadata[f"note{line}"] = note
        elif text:
            break
    header = [field.strip().strip('"') for field in text.split(",")]
    if len(header) > MOST_COLUMNS:
        raise BadRecording(f"{name}: {len(header)} columns; at most {MOST_COLUMNS} are read")
    if all(_is_number(field) for field in header):
        raise BadRecording(
            f"{name}: line {line} holds numbers where the header line (t_s,u_v,y_um) is needed"
        )
    for mark, word in ((";", "semicolons"), ("\t", "tabs")):
        if len(header) == 1 and mark in header[0]:
            raise BadRecording(
                f"{name}: line {line} is separated by {word}; separate the columns by commas and "
                "write decimals with a point"
            )
    for key in header:
        if header.count(key) > 1:
            raise BadRecording(f"{name}: the header names the column {key!r} twice")
    return metadata, header, line


def _blocks(name: str, handle: BinaryIO, line: int) -> Iterator[tuple[int, str]]:
    """Yield (number of its first line, text) of blocks that end at line ends."""
    rest = b""
    while True:
        raw = handle.read(BLOCK_BYTES)
        data = rest + raw
        cut = len(data) if not raw else data.rfind(b"\n") + 1
        block, rest = data[:cut], data[cut:]
        if not raw:
            block = block.removesuffix(END_OF_FILE.encode())
        if block:
            yield line + 1, _decode(name, block, line + 1)
            line += block.count(b"\n")
        if len(rest) > LONGEST_LINE:
            _decode(name, rest, line + 1)
            raise BadRecording(f"{name}: a line is too long for a CSV recording")
        if not raw:
            return


def _decode(name: str, raw: bytes, line: int) -> str:
    if b"\0" in raw:
        before = raw[: raw.index(b"\0")]
        at = line + before.count(b"\n")
        if raw.rstrip(b"\0") == before:
            raise _cut_short(
                name, f"zero bytes from line {at} to the end", "its writer was stopped"
            )
        raise BadRecording(f"{name}: line {at} holds a zero byte: not a text file")
    try:
        return raw.decode("utf-8")
    except UnicodeDecodeError as error:
        at = line + raw[: error.start].count(b"\n")
        raise BadRecording(f"{name}: line {at} is not UTF-8 text") from None


def _parse(name: str, header: list[str], text: str, first_line: int) -> Floats:
    if not text.strip():
        return np.empty((0, len(header)))
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # numpy warns about a block that holds only notes
            plain = io.StringIO(_COMMENT.sub("", text) if "#" in text else text)
            block = np.loadtxt(plain, delimiter=",", comments=None, ndmin=2)
    except (ValueError, OverflowError):
        return _parse_slowly(name, header, text, first_line)
    if block.shape[1] != len(header) or not _plausible(block):
        return _parse_slowly(name, header, text, first_line)
    return block


def _is_cut(last: str, before: str) -> bool:
    """Return whether a last line without an end ends inside its last number."""
    others = before.rstrip("\n").rsplit("\n", MOST_OTHERS)[1:]
    ends = [line.rpartition(",")[2] for line in (last, *others)]
    return ends_inside_number(ends[0], ends[1:], ".")


def _cut_short(name: str, what: str, why: str = "the last line is cut short") -> BadRecording:
    return BadRecording(
        f"{name}: {what}: {why}; dehyst convert --unfinished "
        f"{shlex.quote(name)} whole.csv keeps the lines before"
    )


def _plausible(block: Floats) -> bool:
    with np.errstate(invalid="ignore"):
        return not bool(np.any(np.abs(block) > LARGEST))


def _parse_slowly(name: str, header: list[str], text: str, first_line: int) -> Floats:
    rows = []
    lines = text.split("\n")
    for number, line in enumerate(lines, first_line):
        content = _COMMENT.sub("", line).strip()
        if not content:
            continue
        fields = content.split(",")
        if len(fields) != len(header):
            cut = number == first_line + len(lines) - 1 and len(fields) < len(header)
            what = f"line {number} has {len(fields)} fields, the header has {len(header)}"
            raise _cut_short(name, what) if cut else BadRecording(f"{name}: {what}")
        rows.append([_field(name, number, k, f) for k, f in zip(header, fields, strict=True)])
    return np.array(rows, dtype=np.float64).reshape(-1, len(header))


def _field(name: str, line: int, key: str, field: str) -> float:
    text = field.strip().strip('"')
    if is_missing(text):
        return float("nan")
    try:
        if "_" in text:  # Python reads "1_000" as 1000
            raise ValueError
        value = float(text)
    except ValueError:
        short = text if len(text) <= 20 else text[:20] + "..."
        key = key if len(key) <= 40 else key[:40] + "..."
        raise BadRecording(f"{name}: line {line}: {key} is {short!r}, not a number") from None
    if abs(value) > LARGEST:
        raise BadRecording(f"{name}: line {line}: {key} is {value:g}, beyond any measurement")
    return value


def is_missing(text: str) -> bool:
    """Return whether a field says that there is no value."""
    lower = text.lower()
    if lower in MISSING or not lower.strip("*-+._?"):  # "*****" of Fortran, "--.--" of a display
        return True
    return ("#" in text or "e" in lower) and bool(_NO_NUMBER.fullmatch(lower))


def _is_number(text: str) -> bool:
    try:
        float(text)
    except ValueError:
        return False
    return True


def line_of_row(path: Path, row: int) -> int:
    """Return the line of the file (from 1) that holds data row `row` (from 0)."""
    opener = gzip.open if path.suffix.lower() == ".gz" else open
    seen = -2  # the header line is counted before row 0
    with opener(path, "rb") as handle:
        for number, raw in enumerate(cast(BinaryIO, handle), 1):
            if raw.partition(b"#")[0].strip(b" \t\r\n\xef\xbb\xbf"):
                seen += 1
            if seen == row:
                return number
    return 0
