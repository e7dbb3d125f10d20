"""Turn named arrays of any shape into columns: structures are flattened, texts become notes."""

import math
from collections import Counter
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from dehyst.daemon.files.csv_table import LARGEST, MOST_COLUMNS
from dehyst.daemon.files.foreign.beside import (
    factor_beside,
    factor_of_all,
    group_of,
    label_beside,
    labelled,
    name_columns,
    names_beside,
    notes_of_time,
    period_of_all,
    unit_beside,
    unit_in_lists,
    wave_beside,
)
from dehyst.daemon.files.foreign.containers.blocks import joined_blocks
from dehyst.daemon.files.foreign.epochs import epoch_unit, is_rising
from dehyst.daemon.files.foreign.fields import moment_of, number_of
from dehyst.daemon.files.foreign.found import Column, Given, Sheet, text_of
from dehyst.daemon.files.foreign.headings import apart
from dehyst.daemon.files.foreign.long import describe_channel_rows
from dehyst.daemon.files.foreign.roles import role_of_column
from dehyst.daemon.files.foreign.units import LONGEST_HEADING
from dehyst.models.errors import BadRecording

FEWEST_ROWS = 60
"""Rows from which a model can be identified; fewer next to many are a calibration."""
MOST_WIDE = 64  # columns of one two-dimensional array
MOST_DEEP = 16
MOST_NOTE = 200


def found_in(arrays: Iterable[Given], notes: Mapping[str, str]) -> Sheet:
    """Return the columns in arrays. Single numbers and texts become notes, lists of texts name the
    columns of the arrays next to them; arrays that hold no columns of numbers are left out, which
    is reported."""
    columns: list[Column] = []
    kept = dict(notes)
    left: list[str] = []
    solid: list[str] = []  # of more than two dimensions
    lists: dict[str, list[str]] = {}
    words: dict[str, list[str]] = {}
    wide: list[tuple[Given, list[Column]]] = []
    given, blocks = joined_blocks([replace(one, values=_as_array(one.values)) for one in arrays])
    for one in given:
        name, array = one.name, one.values
        if array.dtype.names:
            for key in array.dtype.names:
                columns += _columns(f"{name}.{key}".strip("."), one.unit, np.asarray(array[key]))
        elif (texts := texts_in(array)) and len(texts) == 1:
            kept[name] = texts[0][:MOST_NOTE]
        elif texts and not (written := _written_in(name, texts)):
            left.append(name)
            words[name] = texts
            lists[name] = [text.strip() for text in texts[:MOST_WIDE]]
            kept[name] = ", ".join(texts[:MOST_WIDE])[:MOST_NOTE]
        elif texts:
            columns += written
        elif array.size == 1 and array.dtype.kind in "biuf":
            kept[name] = repr(float(array.reshape(-1)[0]))
            if one.unit:
                kept[f"{name}_unit"] = one.unit
        elif more := _columns(name, one.unit, array):
            columns += more
            wide.append((one, more))
        elif array.ndim > 2:
            solid.append(name or "the array")
        elif array.size:
            left.append(name)
        if len(columns) > 4 * MOST_COLUMNS:
            break
    for column in columns:
        column.unit = column.unit or unit_beside(column.heading, kept)
        column.unit = column.unit or unit_in_lists(column.heading, lists)
    timing, factors = notes_of_time(kept), 0
    for one, of in wide:
        group = group_of(one.name)
        is_alone = sum(group_of(other.name) == group for other, _ in wide) == 1
        factor = factor_beside(one.name, kept, is_alone)
        factors += bool(factor)
        _name(one, of, columns, lists, kept)
        for column in of:
            column.unit = f"{column.unit}{factor}".strip()
            column.wave = one.wave or wave_beside(one.name, timing)
    step_s, of_some = period_of_all(timing, [one.name for one, _ in wide])
    found = Sheet(columns, kept, step_s, of_some=of_some)
    why_stacked = (describe_channel_rows(k, v, columns) for k, v in words.items())
    found.stacked = next(filter(None, why_stacked), "")
    if not factors and not all(c.unit for c in columns if role_of_column(c) in ("u", "y")):
        found.factor = factor_of_all(kept, {group_of(one.name) for one, _ in wide})
    used = {name for name, texts in lists.items() if any(len(texts) == len(of) for _, of in wide)}
    if solid:
        found.said.append(
            f"of more than two dimensions and left out: {', '.join(solid[:5])}: save one run of "
            "it, a column for each channel"
        )
    if blocks:
        found.said.append(
            f"of two dimensions, in an order that no times show, and left out: "
            f"{', '.join(blocks[:5])}: save the samples of one run one after another"
        )
    if left := [name for name in left if name and name not in used]:
        names = ", ".join(name[:40] for name in left[:5])
        found.said.append(f"without numbers and left out: {names}")
    return found


def _name(
    one: Given,
    of: Sequence[Column],
    columns: Sequence[Column],
    lists: Mapping[str, Sequence[str]],
    notes: Mapping[str, str],
) -> None:
    """Give the columns of an array the names and units that the file states for them."""
    group = group_of(one.name)
    if len(of) > 1:
        beside = {k[len(group) :]: v for k, v in lists.items() if group_of(k) == group}
        names, units = names_beside(one.name[len(group) :], len(of), beside)
        own = one.names if len(one.names) == len(of) else ()
        name_columns(of, own or names, one.units or units)
    elif one.label:
        of[0].heading = labelled(one.name, one.label)
    else:
        is_alone = sum(group_of(column.heading) == group for column in columns) == 1
        of[0].heading = labelled(one.name, label_beside(one.name, notes, is_alone))


def _is_array(value: Any) -> bool:
    return isinstance(value, np.ndarray | list | tuple)


def texts_in(array: Any) -> list[str]:
    """Return the texts of an array that holds nothing else, [] of any other."""
    texts = array.reshape(-1).tolist() if array.dtype.kind in "USO" else []
    return [text_of(t) for t in texts] if all(isinstance(t, str | bytes) for t in texts) else []


def _written_in(name: str, texts: Sequence[str]) -> list[Column]:
    """Return texts as a column if all are times or dates, or if all are numbers with decimal
    points, and too many to be names; [] for others."""
    clock = moment_of(texts[0].strip()) is not None
    if len(texts) < 2 or not (clock or (len(texts) > MOST_COLUMNS and "," not in "".join(texts))):
        return []
    values = [number_of(text) for text in texts]
    if None in values or all(value != value for value in values):
        return []
    return [Column(name, np.array(values, dtype=float), clock=clock)]


def of_one_length(
    name: str, found: Sheet, wanted: Iterable[str] = (), needs: Iterable[str] = ()
) -> Sheet:
    """Keep only the columns of one length. Among the lengths of the wanted columns, or else of all,
    it is that of the time and the drive, or the one with the most roles, or the longest. needs:
    further roles that are required. Raises BadRecording if several lengths hold a drive and a
    displacement, and none is wanted, or none holds both."""
    sizes = {column.values.size for column in found.columns}
    if len(sizes) < 2:
        return found
    named = {str(text).lower() for text in wanted}
    of_wanted = {column.values.size for column in _named_in(found, named)}
    roles: dict[int, set[str]] = {size: set() for size in sizes}
    for c in found.columns:
        roles[c.values.size] |= {role_of_column(c)} - {""}
    runs = sorted(size for size in sizes if {"u", "y"} <= roles[size])
    if len(runs) > 1 and not of_wanted:
        them = ", ".join(f"{size} rows ('{_of_size(found, size)['u'].heading}')" for size in runs)
        whole = next((size for size in runs if size >= FEWEST_ROWS), runs[0])
        option = ",".join(
            f'{role}="{column.heading}"' for role, column in sorted(_of_size(found, whole).items())
        )
        raise BadRecording(
            f"{name}: it holds several runs, of {them}: name the columns of one, such as --columns "
            + option
        )
    needed = _named_in(found, named)
    there = set[str]().union(*(roles[size] for size in of_wanted))
    needed += _first_of_each(found, [role for role in needs if role not in there])
    if len({c.values.size for c in needed}) > 1 and (named or not runs):
        them = " and ".join(f"'{c.heading[:40]}' of {c.values.size} rows" for c in needed[:3])
        raise BadRecording(
            f"{name}: {them} do not belong together row by row: bring them to one rate, and write "
            "them to one file with one column of times"
        )
    counts = Counter(column.values.size for column in found.columns)

    def holds(n: int) -> tuple[bool, int, bool, int]:
        return {"t", "u"} <= roles[n], len(roles[n]), counts[n] > 1, n

    size = max(of_wanted or sizes, key=holds)
    longer = [c for c in found.columns if c.values.size == max(sizes) and role_of_column(c) != "t"]
    if not of_wanted and size < FEWEST_ROWS <= max(sizes) and len(longer) > 1:
        short = next(c.heading[:40] for c in found.columns if c.values.size == size)
        raise BadRecording(
            f"{name}: '{short}' and its like have only {size} rows, other columns {max(sizes)}: "
            "name those of the recording, such as --columns "
            f'u="{longer[0].heading}",y="{longer[1].heading}"'
        )
    left = [c for c in found.columns if c.values.size != size]
    found.columns = [c for c in found.columns if c.values.size == size]
    rows = sorted({c.values.size for c in left})
    found.said.append(
        "of another length and left out: "
        + ", ".join(c.heading[:40] for c in left[:5])
        + ", ..." * (len(left) > 5)
        + f" ({rows[0]}{f' to {rows[-1]}' if rows[1:] else ''} rows, "
        f"'{found.columns[0].heading[:40]}' has {size}): if one is the drive or the "
        "displacement, bring it to the same rows in the program that wrote the file"
    )
    return found


def _first_of_each(found: Sheet, needs: Iterable[str]) -> list[Column]:
    """Return the first drive and the first displacement, if they are required."""
    of = {role_of_column(c): c for c in reversed(found.columns)}
    return [of[role] for role in "uy" if role in needs and role in of]


def _named_in(found: Sheet, named: set[str]) -> list[Column]:
    return [c for c in found.columns if {c.heading.lower(), str(c.number)} & named]


def _of_size(found: Sheet, size: int) -> dict[str, Column]:
    """Return the first column of this length for each role of t, u and y."""
    out: dict[str, Column] = {}
    for column in found.columns:
        role = role_of_column(column)
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
        except (TypeError, ValueError, OverflowError):
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


def by_columns(value: Any) -> Any:
    """Return nested values with columns in place of lists of rows: [{"t": 0, "u": 1}, ...] and
    pandas' {"t": {"0": 0.0, "1": 0.1}} are {"t": [...], "u": [...]}."""
    if isinstance(value, dict):
        keys = list(value)
        if len(keys) > 1 and keys == [str(i) for i in range(len(keys))]:
            return by_columns(list(value.values()))
        return {key: by_columns(inner) for key, inner in value.items()}
    rows = value if isinstance(value, list) and len(value) > 1 else []
    if rows and all(isinstance(row, dict) for row in rows):
        value = [dict(_fields_of(row)) for row in rows]
        names = dict.fromkeys(key for row in value for key in row)
        if all(not isinstance(row.get(key), dict | list) for row in value for key in names):
            return {name: [row.get(name) for row in value] for name in names}
        return rows
    head = rows[0] if len(rows) > 2 and isinstance(rows[0], list) else []
    named = bool(head) and all(isinstance(n, str) and moment_of(n) is None for n in head)
    if named and all(isinstance(row, list) and len(row) == len(head) for row in rows):
        return {name: [row[j] for row in rows[1:]] for j, name in enumerate(apart(head))}
    return value


def _fields_of(row: Mapping[str, Any], front: str = "") -> Iterator[tuple[str, Any]]:
    """Yield the values of nested maps with their path: {"fields": {"u": 1}} has "fields.u"."""
    for key, inner in row.items():
        if isinstance(inner, dict) and len(front) < LONGEST_HEADING:
            yield from _fields_of(inner, f"{front}{key}.")
        else:
            yield f"{front}{key}", inner


def flattened(value: Any, name: str = "", deep: int = 0) -> Iterator[tuple[str, Any]]:
    """Yield (name with its path, array) of nested maps and lists; of a list that holds arrays or
    maps, each with its number."""
    if deep > MOST_DEEP:
        return
    if isinstance(value, Mapping):
        for key, inner in value.items():
            yield from flattened(inner, f"{name}.{key}".strip("."), deep + 1)
        return
    listed = isinstance(value, np.ndarray) and value.dtype.kind == "O"
    parts = list(value.reshape(-1)) if listed else value
    nested = isinstance(parts, list | tuple) and 0 < len(parts) <= MOST_WIDE
    if not nested or not any(_is_array(part) or isinstance(part, Mapping) for part in parts):
        yield name, value
    elif (side_by_side := _stacked(parts)) is not None:
        yield name, side_by_side
    else:
        for i, inner in enumerate(parts):
            yield from flattened(inner, name if len(parts) == 1 else f"{name}.{i}", deep + 1)


def _stacked(parts: Sequence[Any]) -> Any:
    """Return lists of numbers of one length as an array, None of anything else."""
    arrays = [_as_array(part).squeeze() for part in parts]
    alike = {(array.shape, array.dtype.kind in "biuf") for array in arrays}
    return np.stack(arrays) if alike == {((arrays[0].size,), True)} else None


def _as_array(values: Any) -> Any:
    """Return values as an array, an empty one of lists of several lengths."""
    try:
        return np.asarray(values)
    except ValueError:
        return np.empty(0)
