"""Turn named arrays of any shape into columns: structures are flattened, texts become notes."""

import math
from collections.abc import Iterable, Iterator, Mapping
from typing import Any

import numpy as np

from dehyst.daemon.files.csv_table import LARGEST, MOST_COLUMNS
from dehyst.daemon.files.foreign.epochs import epoch_unit, is_rising
from dehyst.daemon.files.foreign.found import Column, Sheet
from dehyst.daemon.files.foreign.roles import role_of
from dehyst.daemon.files.foreign.units import find_unit_key, split_heading
from dehyst.models.errors import BadRecording

MOST_WIDE = 64  # columns of one two-dimensional array
MOST_DEEP = 16
MOST_NOTE = 200
_UNIT_FIELDS, _LABEL_FIELDS = ("unit", "units"), ("label", "name", "title")


def found_in(arrays: Iterable[tuple[str, str, Any]], notes: Mapping[str, str]) -> Sheet:
    """Return the columns in arrays (name, unit, values). Single numbers and texts become notes;
    arrays that hold no columns of numbers are left out, which is reported."""
    columns: list[Column] = []
    kept = dict(notes)
    left: list[str] = []
    for name, unit, values in arrays:
        array = np.asarray(values)
        if array.dtype.names:
            for key in array.dtype.names:
                columns += _columns(f"{name}.{key}".strip("."), unit, np.asarray(array[key]))
        elif array.dtype.kind in "US" or (array.dtype.kind == "O" and array.size == 1):
            if array.size == 1:
                kept[name] = str(array.reshape(-1)[0])[:MOST_NOTE]
            else:
                left.append(name)
                texts = (str(text) for text in array.reshape(-1)[:MOST_WIDE])
                kept[name] = ", ".join(texts)[:MOST_NOTE]
        elif array.size == 1 and array.dtype.kind in "biuf":
            kept[name] = repr(float(array.reshape(-1)[0]))
        elif more := _columns(name, unit, array):
            columns += more
        elif array.size:
            left.append(name)
        if len(columns) > 4 * MOST_COLUMNS:
            break
    for column in columns:
        column.unit = column.unit or _unit_beside(column.heading, kept)
    found = Sheet(columns, kept)
    if left:
        found.said.append(f"without numbers and left out: {', '.join(left[:5])}")
    return found


def _unit_beside(heading: str, notes: Mapping[str, str]) -> str:
    """Return the unit that a structure states beside its numbers, "" if it states none:
    "rec.drive.unit" or "signals.0.label" ("Drive [mV]") for "rec.drive.data"."""
    for mark in "/.":
        group, _, last = heading.rpartition(mark)
        if not group or last.lower() in _UNIT_FIELDS:
            continue
        beside = {
            name[len(group) + 1 :].lower(): text
            for name, text in notes.items()
            if name.startswith(group + mark)
        }
        if unit := next((beside[key] for key in _UNIT_FIELDS if key in beside), ""):
            return unit
        of_label = [split_heading(beside[key])[1] for key in _LABEL_FIELDS if key in beside]
        if any(of_label):
            return next(filter(None, of_label))
    return ""


def of_one_length(name: str, found: Sheet, wanted: Iterable[str] = ()) -> Sheet:
    """Keep only columns of one length: of the wanted columns or else of all, that of the time and
    the drive, or of most roles, or the longest. Raises BadRecording if several lengths hold a drive
    and a displacement, and none is wanted."""
    sizes = {column.values.size for column in found.columns}
    if len(sizes) < 2:
        return found
    named = {str(text).lower() for text in wanted}
    of_wanted = {c.values.size for c in found.columns if {c.heading.lower(), str(c.number)} & named}
    roles: dict[int, set[str]] = {size: set() for size in sizes}
    for c in found.columns:
        roles[c.values.size] |= {role_of(c.heading, find_unit_key(c.unit))[0]} - {""}
    runs = sorted(size for size in sizes if {"u", "y"} <= roles[size])
    if len(runs) > 1 and not of_wanted:
        them = ", ".join(f"{size} rows ('{_of_size(found, size)['u'].heading}')" for size in runs)
        option = ",".join(
            f'{role}="{column.heading}"'
            for role, column in sorted(_of_size(found, runs[0]).items())
        )
        raise BadRecording(
            f"{name}: it holds several runs, of {them}: name the columns of one, such as --columns "
            + option
        )
    size = max(of_wanted or sizes, key=lambda n: ({"t", "u"} <= roles[n], len(roles[n]), n))
    left = [c.heading for c in found.columns if c.values.size != size]
    found.columns = [c for c in found.columns if c.values.size == size]
    found.said.append(
        f"of another length and left out: {', '.join(left[:5])}{', ...' * (len(left) > 5)}"
    )
    return found


def _of_size(found: Sheet, size: int) -> dict[str, Column]:
    """Return the first column of this length for each role of t, u and y."""
    out: dict[str, Column] = {}
    for column in found.columns:
        role = role_of(column.heading, find_unit_key(column.unit))[0]
        if column.values.size == size and role in ("t", "u", "y"):
            out.setdefault(role, column)
    return out


def _columns(name: str, unit: str, array: Any) -> list[Column]:
    clock = array.dtype.kind in "Mm"
    if clock:
        array = _seconds(array)
    elif array.dtype.kind == "O":
        try:
            array = array.astype(np.float64)
        except (TypeError, ValueError):
            return []
    if array.dtype.kind not in "biuf":
        return []
    array = array.squeeze() if array.ndim > 1 else array
    if array.dtype.kind in "iu" and array.ndim == 1 and array.size and array[0] > LARGEST:
        first, long = int(array[0]), array.astype(np.uint64)
        counted = (long - long[0]).astype(np.int64)  # modulo 2**64, so that earlier is negative
        if is_rising(counted):
            unit, array = unit or epoch_unit(first, name), counted
    if array.ndim == 1 and array.size > 1:
        return [Column(name, np.ascontiguousarray(array, dtype=np.float64), unit, clock)]
    if array.ndim != 2:
        return []
    tall = array if array.shape[0] >= array.shape[1] else array.T
    if tall.shape[1] > MOST_WIDE:
        return []
    return [
        Column(
            f"{name}.{j}" if name else "",
            np.ascontiguousarray(tall[:, j], dtype=np.float64),
            unit,
            clock,
        )
        for j in range(tall.shape[1])
    ]


def _seconds(moments: Any) -> Any:
    """Return timestamps or durations in seconds, NaN if missing; timestamps count from the first
    one."""
    missing = np.isnat(moments)
    out = np.full(moments.shape, math.nan)
    known = moments[~missing]
    if known.size:
        whole = known.astype("m8[ns]" if moments.dtype.kind == "m" else "M8[ns]")
        zero = np.timedelta64(0, "ns") if moments.dtype.kind == "m" else whole.reshape(-1)[0]
        out[~missing] = (whole - zero) / np.timedelta64(1, "ns") / 1e9
    return out


def flattened(value: Any, name: str = "", deep: int = 0) -> Iterator[tuple[str, Any]]:
    """Yield (name with its path, array) of nested maps and lists."""
    if deep > MOST_DEEP:
        return
    if isinstance(value, Mapping):
        for key, inner in value.items():
            yield from flattened(inner, f"{name}.{key}".strip("."), deep + 1)
    elif isinstance(value, list | tuple) and value and isinstance(value[0], Mapping):
        for i, inner in enumerate(value[:MOST_WIDE]):
            yield from flattened(inner, f"{name}.{i}", deep + 1)
    elif (
        isinstance(value, np.ndarray)
        and value.dtype.kind == "O"
        and 0 < value.size <= MOST_WIDE
        and isinstance(value.reshape(-1)[0], Mapping)
    ):
        for i, inner in enumerate(value.reshape(-1)):
            yield from flattened(inner, f"{name}.{i}", deep + 1)
    else:
        yield name, value
