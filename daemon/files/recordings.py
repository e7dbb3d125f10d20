"""Read recordings and trajectories from files of all supported kinds or from arrays by name; write
them as .csv, .csv.gz, .npz and .mcap.

Column names carry the units: `t_s`, the drive `u_v` (or `u_um`, ...), the displacement `y_um` (or
`y_nm`, `y_v`, `y_counts`, ...). Any other column is kept as a further channel; other axes of the
stage (`axis_y_um`, see axis_columns.py) become `axis.y`. Empty fields and NaN are missing samples,
and stay missing. Files of other programs are interpreted first (see loading.py); the interpretation
is kept in the recording's `read` and in the notes that `dehyst convert` writes. Every damaged file
raises BadRecording with a one-line message.
"""

import gzip
import hashlib
import itertools
import shlex
from collections.abc import Iterable, Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from dehyst.daemon.files.axis_columns import targets_as_channels, to_channels
from dehyst.daemon.files.foreign.reading import AS_IT_IS, ReadOptions
from dehyst.daemon.files.loading import SUFFIXES, Loaded, load_columns, understand_columns
from dehyst.daemon.files.mcap_file import write_mcap
from dehyst.daemon.files.number_text import number_texts
from dehyst.daemon.files.outputs import report_failures, whole_file
from dehyst.daemon.files.sidecar import write_notes
from dehyst.daemon.files.times import Times, doubt_seconds, repair_times
from dehyst.daemon.printable import in_utf8, printable
from dehyst.models.errors import BadRecording
from dehyst.models.recording import Floats, Recording, Trajectory
from dehyst.models.units import UNIT_NAMES, how_many

WRITTEN = (".csv", ".csv.gz", ".npz", ".mcap")
MEASURED_FIRST = sorted(UNIT_NAMES, key=lambda unit: unit in ("v", "counts"))
READ = "read"
"""Key of the note that says how a file of another program was interpreted."""
__all__ = ["SUFFIXES", "WRITTEN"]


def read_recording(
    path: str | Path,
    *,
    need_displacement: bool = False,
    min_rows: int = 2,
    reading: ReadOptions = AS_IT_IS,
) -> Recording:
    """Return the recording in a file.

    need_displacement: refuse a file without a `y_...` column. min_rows: refuse a file with fewer
    rows. reading: how to interpret a file of another program. Raises BadRecording with one line
    that names the file, the line or column, and the remedy; also if the clock went back, so that
    the file holds several recordings.
    """
    parts = read_recordings(
        path, need_displacement=need_displacement, min_rows=min_rows, reading=reading
    )
    if len(parts) > 1:
        raise BadRecording(_several(Path(path), len(parts)))
    return parts[0]


def read_recordings(
    path: str | Path,
    *,
    need_displacement: bool = False,
    min_rows: int = 2,
    reading: ReadOptions = AS_IT_IS,
) -> list[Recording]:
    """Like read_recording, but return several recordings if the clock went back: the file is cut
    there."""
    path = Path(path)
    wants = ("t", "u", "y") if need_displacement else ("t", "u")
    loaded = load_columns(path, reading, wants=wants)
    parts = _recordings(printable(path.name), loaded, need_displacement, min_rows, reading)
    digest = _sha256(path)
    if len(parts) == 1:
        return [replace(parts[0], sha256=digest)]
    return [
        replace(one, sha256=hashlib.sha256(f"{digest} {i}".encode()).hexdigest())
        for i, one in enumerate(parts, 1)
    ]


def recording_of(
    columns: Mapping[str, Any],
    name: str,
    *,
    need_displacement: bool = False,
    min_rows: int = 2,
    reading: ReadOptions = AS_IT_IS,
) -> Recording:
    """Return the recording in arrays (N,) by column name, as `read_recording` returns it from a
    file."""
    wants = ("t", "u", "y") if need_displacement else ("t", "u")
    loaded = understand_columns(name, columns, reading, wants)
    parts = _recordings(name, loaded, need_displacement, min_rows, reading)
    if len(parts) > 1:
        raise BadRecording(_several(Path(name), len(parts)))
    return parts[0]


def _several(path: Path, parts: int) -> str:
    return (
        f"{path.name}: the clock goes back, so that there are {parts} recordings in it; dehyst "
        f"convert {shlex.quote(path.name)} part.csv writes each to a separate file"
    )


def _recordings(
    name: str, loaded: Loaded, need_displacement: bool, min_rows: int, reading: ReadOptions
) -> list[Recording]:
    columns = loaded.columns
    times = _time(name, loaded, min_rows)
    drive = _unit_column(name, loaded, "u", "drive", required=True)
    disp = _unit_column(name, loaded, "y", "displacement", required=need_displacement)
    longest = max(times.parts, key=lambda part: part[1] - part[0])
    known = loaded.seconds or bool(reading.time_unit)
    doubt = doubt_seconds(name, times.t_s[slice(*longest)], known)
    others = [f"y_{unit}" for unit in UNIT_NAMES if f"y_{unit}" in columns and f"y_{unit}" != disp]
    which = f"displacement from {disp}, not from {' or '.join(others)}" if others else ""
    said = _say(name, loaded, times, which, doubt)
    further = {k: v for k, v in columns.items() if k not in ("t_s", drive, disp)}
    channels = to_channels(further, disp[2:] if disp else "um", drive[2:])
    out = []
    for i, (begin, end) in enumerate(times.parts, 1):
        if end - begin < min_rows and len(times.parts) > 1:
            continue

        def cut(values: Floats, begin: int = begin, end: int = end) -> Floats:
            return (values if times.keep is None else values[times.keep])[begin:end]

        out.append(
            Recording(
                t_s=times.t_s[begin:end],
                drive=cut(columns[drive]),
                displacement=cut(columns[disp]) if disp else None,
                drive_unit=drive[2:],
                displacement_unit=disp[2:] if disp else "um",
                channels={key: cut(values) for key, values in channels.items()},
                metadata=loaded.notes,
                name=name if len(times.parts) == 1 else f"{name} (part {i})",
                read=said,
            )
        )
    if not out:
        raise BadRecording(f"{name}: no part of it has {how_many(min_rows, 'row')}")
    return out


def _say(name: str, loaded: Loaded, times: Times, *remarks: str) -> str:
    said = [text for text in (loaded.said, *times.said, *remarks) if text]
    return f"{name}: read {how_many(times.t_s.size, 'row')}: {'; '.join(said)}" if said else ""


def read_trajectory(
    path: str | Path, *, min_rows: int = 1, column: str = "", reading: ReadOptions = AS_IT_IS
) -> Trajectory:
    """Return the trajectory in a file with the columns `t_s` and `target_um` (or another unit).

    column: use this column instead; its name ends in the unit (`y_um`). Raises BadRecording like
    read_recording, and if a target is missing.
    """
    path = Path(path)
    loaded = load_columns(path, reading, wants=("t",) if column else ("t", "target"))
    return replace(
        _trajectory(printable(path.name), loaded, min_rows, column), sha256=_sha256(path)
    )


def trajectory_of(columns: Mapping[str, Any], name: str, *, min_rows: int = 1) -> Trajectory:
    """Return the trajectory in arrays (N,) by column name, as `read_trajectory` returns it from a
    file."""
    loaded = understand_columns(name, columns, AS_IT_IS, ("t", "target"))
    return _trajectory(name, loaded, min_rows, "")


def _trajectory(name: str, loaded: Loaded, min_rows: int, column: str) -> Trajectory:
    times = _time(name, loaded, min_rows)
    if len(times.parts) > 1:
        raise BadRecording(f"{name}: {times.said[-1]}; the times of a trajectory must not go back")
    columns = loaded.columns
    if times.keep is not None:
        columns = {key: values[times.keep] for key, values in columns.items()}
    _, _, unit = column.rpartition("_")
    if column and (column not in columns or unit not in UNIT_NAMES):
        raise BadRecording(
            f"{name}: no column {column} with a unit ({', '.join(UNIT_NAMES)}) at its end; "
            f"there are {_listed(columns)}"
        )
    key = column or _unit_column(name, loaded, "target", "target", required=True)
    missing = ~np.isfinite(loaded.columns[key])
    if times.keep is not None:
        missing &= times.keep
    if missing.any():
        raise BadRecording(f"{name}: {loaded.where(int(np.argmax(missing)))}: {key} is missing")
    further = {k: values for k, values in columns.items() if k not in ("t_s", key)}
    unit = key.rpartition("_")[2]
    channels = targets_as_channels(further, unit)
    said = _say(name, loaded, times)
    return Trajectory(times.t_s, columns[key], unit, name, channels=channels, read=said)


def read_columns(
    path: str | Path, unfinished: bool = False, reading: ReadOptions = AS_IT_IS
) -> tuple[dict[str, Floats], dict[str, str]]:
    """Return (columns by name including `t_s`, notes) of a file, whatever the columns mean.
    unfinished: read the complete part of a file whose writer was killed. Raises BadRecording."""
    parts, _ = read_parts(path, unfinished, reading)
    if len(parts) > 1:
        raise BadRecording(_several(Path(path), len(parts)))
    return parts[0]


def read_parts(
    path: str | Path, unfinished: bool = False, reading: ReadOptions = AS_IT_IS
) -> tuple[list[tuple[dict[str, Floats], dict[str, str]]], str]:
    """Like read_columns, but return several parts if the clock went back (the file is cut there),
    and how a file of another program was interpreted, which is also in the notes."""
    path = Path(path)
    name = printable(path.name)
    loaded = load_columns(path, reading, unfinished, wants=("t",))
    times = _time(name, loaded, 1)
    doubt = ""
    kinds = {key.partition("_")[0] for key in loaded.columns}
    if "target" not in kinds or kinds & {"u", "y"}:  # a trajectory may be as slow as it likes
        longest = max(times.parts, key=lambda part: part[1] - part[0])
        known = loaded.seconds or bool(reading.time_unit)
        doubt = doubt_seconds(name, times.t_s[slice(*longest)], known)
    said = _say(name, loaded, times, doubt)
    notes = {**loaded.notes, **({READ: said} if said else {})}
    columns = loaded.columns
    if times.keep is not None:
        columns = {key: values[times.keep] for key, values in columns.items()}
    columns = {**columns, "t_s": times.t_s}
    cut = [
        ({key: values[begin:end] for key, values in columns.items()}, notes)
        for begin, end in times.parts
    ]
    return cut, said


def write_recording(
    path: str | Path,
    t_s: Floats,
    columns: Mapping[str, Any],
    metadata: Mapping[str, str] | None = None,
) -> None:
    """Write time and columns (name with unit -> (N,) values) so that reading returns the same bits.

    The suffix selects the format: .csv, .csv.gz, .npz or .mcap. A CSV begins with its header line;
    its metadata goes into NAME.csv.meta.json. The file appears complete or not at all. Raises
    BadRecording on unequal lengths, an unknown suffix, or a path that cannot be written.
    """
    path = Path(path)
    table = {"t_s": np.asarray(t_s)} | {k: np.asarray(v) for k, v in columns.items()}
    for key, values in table.items():
        if values.shape != (len(t_s),):
            raise BadRecording(
                f"{path.name}: {key} has the shape {values.shape}, not ({len(t_s)},)"
            )
    if not path.name.endswith(WRITTEN):
        raise BadRecording(f"{path.name}: unknown kind of file; {', '.join(WRITTEN)} are written")
    notes = {key: in_utf8(str(value)) for key, value in (metadata or {}).items()}
    lines = (line.encode() for line in _csv_lines(table))
    with report_failures(path, BadRecording):
        with whole_file(path) as file:
            if path.suffix == ".npz":
                arrays: dict[str, Any] = {**table}
                arrays |= {f"#{k}": np.array(v) for k, v in notes.items()}
                np.savez_compressed(file, **arrays)
            elif path.suffix == ".mcap":
                write_mcap(file, table, notes)
            elif path.suffix == ".gz":
                with gzip.GzipFile(path.name, "wb", 4, file) as packed:
                    packed.writelines(lines)
            else:
                file.writelines(lines)
        if path.suffix in (".csv", ".gz"):
            write_notes(path, notes)


def _csv_lines(table: Mapping[str, Any]) -> Iterable[str]:
    yield ",".join(table) + "\n"
    size = len(next(iter(table.values())))
    for start in range(0, size, 65536):
        block = [number_texts(v[start : start + 65536], "nan") for v in table.values()]
        yield from (",".join(row) + "\n" for row in zip(*block, strict=True))


def _time(name: str, loaded: Loaded, min_rows: int) -> Times:
    columns = loaded.columns
    if "t_s" not in columns:
        raise BadRecording(
            f"{name}: no column t_s (time in seconds); there are {_listed(columns)}; --columns "
            "t=... names it, --rate HZ counts the rows"
        )
    t_s = columns["t_s"]
    if t_s.size < min_rows:
        raise BadRecording(
            f"{name}: {how_many(t_s.size, 'row')} of data; at least {min_rows} are needed here"
        )

    def same_row(row: int) -> bool:
        return all(
            v[row] == v[row - 1] or (np.isnan(v[row]) and np.isnan(v[row - 1]))
            for v in columns.values()
        )

    return repair_times(name, t_s, same_row, loaded.where)


def _unit_column(name: str, loaded: Loaded, letter: str, what: str, required: bool) -> str:
    """Return the name of the column of this kind. The first known unit wins: u_v precedes u_um, but
    y_um precedes y_v, the voltage of its sensor."""
    columns = loaded.columns
    for unit in UNIT_NAMES if letter == "u" else MEASURED_FIRST:
        if f"{letter}_{unit}" in columns:
            key = f"{letter}_{unit}"
            if np.any(np.isinf(columns[key])):
                row = int(np.flatnonzero(np.isinf(columns[key]))[0])
                raise BadRecording(f"{name}: {loaded.where(row)}: {key} is infinite")
            return key
    near = [key for key in columns if key == letter or key.rpartition("_")[0] == letter]
    units = ", ".join(f"{letter}_{unit}" for unit in UNIT_NAMES)
    if near and (required or letter == "y"):
        raise BadRecording(
            f"{name}: {near[0]} is not a {what} in a unit that is known; --columns "
            f"{letter}={near[0]} and its unit read it, or rename it to one of {units}"
        )
    if required:
        raise BadRecording(
            f"{name}: no {what} column ({units}); there are {_listed(columns)}; --columns "
            f"{letter}=... names it"
        )
    return ""


def _listed(columns: Mapping[str, Floats]) -> str:
    names = [
        "".join(c if c.isprintable() else "?" for c in key[:30])
        for key in itertools.islice(columns, 8)
    ]
    return ", ".join(names) + (", ..." if len(columns) > 8 else "")


def _sha256(path: Path) -> str:
    with path.open("rb") as handle:
        return hashlib.file_digest(handle, "sha256").hexdigest()
