"""Recordings and trajectories on disk: .csv, .csv.gz, .npz, .mcap, .mat; and from arrays by name.

Column names carry the units: `t_s`, the drive `u_v` (or `u_um`, ...), the displacement `y_um`
(or `y_nm`, `y_v`, `y_counts`, ...), anything else is kept as a further channel, other axes of the
stage (`axis_y_um`, see axis_columns.py) as `axis.y`. Empty fields and
NaN are missing samples; they stay missing. Every damaged file ends in one BadRecording line.
"""

import gzip
import hashlib
import itertools
import struct
import zipfile
import zlib
from collections.abc import Callable, Iterable, Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from dehyst.daemon.files.axis_columns import targets_as_channels, to_channels
from dehyst.daemon.files.csv_table import LARGEST, MOST_BYTES, Table, line_of_row, read_table
from dehyst.daemon.files.mat_file import read_mat
from dehyst.daemon.files.mcap_file import read_mcap, write_mcap
from dehyst.daemon.files.number_text import number_texts
from dehyst.daemon.files.outputs import whole_file
from dehyst.daemon.files.sidecar import read_notes, write_notes
from dehyst.models.errors import BadRecording
from dehyst.models.modelfile import UNIT_NAMES
from dehyst.models.recording import Floats, Recording, Trajectory, first_not_increasing

SUFFIXES = (".csv", ".csv.gz", ".npz", ".mcap", ".mat")
WRITTEN = (".csv", ".csv.gz", ".npz", ".mcap")


def read_recording(
    path: str | Path, *, need_displacement: bool = False, min_rows: int = 2
) -> Recording:
    """The recording in a file.

    need_displacement: a file without a `y_...` column is refused. min_rows: fewer are refused.
    Raises BadRecording, one line that names the file, the line or column, and the remedy.
    """
    path = Path(path)
    recording = _recording(path, _load(path), need_displacement, min_rows)
    return replace(recording, sha256=_sha256(path))


def recording_of(
    columns: Mapping[str, Any], name: str, *, need_displacement: bool = False, min_rows: int = 2
) -> Recording:
    """The recording in arrays (N,) by column name, as `read_recording` has it from a file."""
    table = Table(_columns(Path(name), columns), {})
    return _recording(Path(name), table, need_displacement, min_rows)


def _recording(path: Path, table: Table, need_displacement: bool, min_rows: int) -> Recording:
    columns = table.columns
    t_s = _time(path, columns, min_rows)
    drive = _unit_column(path, columns, "u", "drive", required=True)
    disp = _unit_column(path, columns, "y", "displacement", required=need_displacement)
    further = {k: v for k, v in columns.items() if k not in ("t_s", drive, disp)}
    channels = to_channels(further, disp[2:] if disp else "um", drive[2:])
    return Recording(
        t_s=t_s,
        drive=columns[drive],
        displacement=columns[disp] if disp else None,
        drive_unit=drive[2:],
        displacement_unit=disp[2:] if disp else "um",
        channels=channels,
        metadata=table.metadata,
        name=path.name,
    )


def read_trajectory(path: str | Path, *, min_rows: int = 1, column: str = "") -> Trajectory:
    """The trajectory in a file with the columns `t_s` and `target_um` (or another unit).

    column: take this one instead, its name ends in the unit (`y_um`).
    Raises BadRecording as read_recording does, and when a target is missing somewhere.
    """
    path = Path(path)
    trajectory = _trajectory(path, _load(path).columns, min_rows, column)
    return replace(trajectory, sha256=_sha256(path))


def trajectory_of(columns: Mapping[str, Any], name: str, *, min_rows: int = 1) -> Trajectory:
    """The trajectory in arrays (N,) by column name, as `read_trajectory` has it from a file."""
    return _trajectory(Path(name), _columns(Path(name), columns), min_rows, "")


def _trajectory(
    path: Path, columns: Mapping[str, Floats], min_rows: int, column: str
) -> Trajectory:
    t_s = _time(path, columns, min_rows)
    _, _, unit = column.rpartition("_")
    if column and (column not in columns or unit not in UNIT_NAMES):
        raise BadRecording(
            f"{path.name}: no column {column} with a unit ({', '.join(UNIT_NAMES)}) at its end; "
            f"there are {_listed(columns)}"
        )
    key = column or _unit_column(path, columns, "target", "target", required=True)
    row = np.flatnonzero(~np.isfinite(columns[key]))
    if row.size:
        raise BadRecording(f"{path.name}: {_where(path, int(row[0]))}: {key} is missing")
    further = {name: values for name, values in columns.items() if name not in ("t_s", key)}
    unit = key.rpartition("_")[2]
    channels = targets_as_channels(further, unit)
    return Trajectory(t_s, columns[key], unit, path.name, channels=channels)


def read_columns(
    path: str | Path, unfinished: bool = False
) -> tuple[dict[str, Floats], dict[str, str]]:
    """(columns by name, `t_s` among them; notes) of a file, whatever they mean. unfinished: what
    is whole of an .mcap whose writer was killed. Raises BadRecording."""
    table = _load(Path(path), unfinished)
    _time(Path(path), table.columns, 1)
    return dict(table.columns), dict(table.metadata)


def write_recording(
    path: str | Path,
    t_s: Floats,
    columns: Mapping[str, Any],
    metadata: Mapping[str, str] | None = None,
) -> None:
    """Write time and columns (name with unit -> (N,) values) so that reading gives the same bits.

    The suffix chooses the format: .csv, .csv.gz, .npz or .mcap. A CSV begins with its header line;
    its metadata goes into NAME.csv.meta.json. The file appears complete or not at all. Raises
    BadRecording on unequal lengths, an unknown suffix, a place that cannot be written.
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
    lines = (line.encode() for line in _csv_lines(table))
    try:
        with whole_file(path) as file:
            if path.suffix == ".npz":
                arrays: dict[str, Any] = {**table}
                arrays |= {f"#{k}": np.array(v) for k, v in (metadata or {}).items()}
                np.savez_compressed(file, **arrays)
            elif path.suffix == ".mcap":
                write_mcap(file, table, metadata or {})
            elif path.suffix == ".gz":
                with gzip.GzipFile(path.name, "wb", 4, file) as packed:
                    packed.writelines(lines)
            else:
                file.writelines(lines)
        if path.suffix in (".csv", ".gz"):
            write_notes(path, metadata or {})
    except OSError as error:
        raise BadRecording(f"{path}: cannot be written: {error.strerror or error}") from None


def _csv_lines(table: Mapping[str, Any]) -> Iterable[str]:
    yield ",".join(table) + "\n"
    size = len(next(iter(table.values())))
    for start in range(0, size, 65536):
        block = [number_texts(v[start : start + 65536], "nan") for v in table.values()]
        yield from (",".join(row) + "\n" for row in zip(*block, strict=True))


def _load(path: Path, unfinished: bool = False) -> Table:
    name = path.name
    if path.is_dir():
        raise BadRecording(f"{path}: is a directory, not a recording")
    if not path.exists():
        raise BadRecording(f"{path}: no such file")
    if not path.is_file():
        raise BadRecording(f"{path}: is not an ordinary file")
    readers: dict[str, Callable[[Path], Table]] = {
        ".npz": _read_npz,
        ".mat": _read_mat,
        ".mcap": lambda path: _read_mcap(path, unfinished),
    }
    if not name.endswith(SUFFIXES):
        raise BadRecording(f"{name}: unknown kind of file; {', '.join(SUFFIXES)} are read")
    if unfinished and path.suffix != ".mcap":
        raise BadRecording(f"{name}: only an .mcap file can be unfinished; read it as it is")
    table = readers.get(path.suffix, _read_csv)(path)
    if not table.columns:
        raise BadRecording(f"{name}: the file holds no columns")
    return table


def _read_csv(path: Path) -> Table:
    table = read_table(path)
    return replace(table, metadata={**table.metadata, **read_notes(path)})


def _read_npz(path: Path) -> Table:
    if not zipfile.is_zipfile(path):
        raise BadRecording(f"{path.name}: not an .npz file")
    try:
        with zipfile.ZipFile(path) as members:
            size = sum(member.file_size for member in members.infolist())
        if size > MOST_BYTES:
            raise BadRecording(
                f"{path}: unpacks to {size >> 20} MB; at most {MOST_BYTES >> 20} MB "
                "are read; cut it into several files"
            )
        with np.load(path, allow_pickle=False) as data:
            arrays = {key: data[key] for key in data.files}
    except (
        OSError,
        ValueError,
        KeyError,
        EOFError,
        RuntimeError,
        OverflowError,
        MemoryError,
        struct.error,
        zlib.error,
        zipfile.BadZipFile,
    ) as error:
        raise BadRecording(f"{path}: not an .npz file that can be read: {error}") from None
    notes = {k[1:]: str(v) for k, v in arrays.items() if k.startswith("#")}
    return Table(_columns(path, {k: v for k, v in arrays.items() if k[:1] != "#"}), notes)


def _read_mat(path: Path) -> Table:
    return Table(_columns(path, read_mat(path)), {})


def _read_mcap(path: Path, unfinished: bool) -> Table:
    columns, notes = read_mcap(path, unfinished)
    return Table(_columns(path, columns), notes)


def _columns(path: Path, arrays: Mapping[str, Any]) -> dict[str, Floats]:
    columns = {}
    for key, values in arrays.items():
        try:
            columns[key] = np.ascontiguousarray(values, dtype=np.float64).reshape(-1)
        except (TypeError, ValueError, MemoryError):
            raise BadRecording(f"{path.name}: {key} does not hold numbers") from None
        if np.any(np.abs(columns[key][np.isfinite(columns[key])]) > LARGEST):
            raise BadRecording(f"{path.name}: {key} holds numbers beyond any measurement")
    sizes = {key: values.size for key, values in columns.items()}
    if len(set(sizes.values())) > 1:
        raise BadRecording(f"{path.name}: columns of unequal length: {sizes}")
    return columns


def _time(path: Path, columns: Mapping[str, Floats], min_rows: int) -> Floats:
    if "t_s" not in columns:
        raise BadRecording(
            f"{path.name}: no column t_s (time in seconds); there are {_listed(columns)}"
        )
    t_s = columns["t_s"]
    if t_s.size < min_rows:
        raise BadRecording(
            f"{path.name}: {t_s.size} rows of data; at least {min_rows} are needed here"
        )
    row = first_not_increasing(t_s)
    if row >= 0:
        before = f" ({t_s[row]:.9g} after {t_s[row - 1]:.9g})" if row else ""
        raise BadRecording(
            f"{path.name}: {_where(path, row)}: t_s does not increase{before}; "
            "sort the rows and remove duplicates"
        )
    return t_s


def _unit_column(
    path: Path, columns: Mapping[str, Floats], letter: str, what: str, required: bool
) -> str:
    """The column of that kind: the first known unit wins, so u_v comes before u_um."""
    for unit in UNIT_NAMES:
        if f"{letter}_{unit}" in columns:
            key = f"{letter}_{unit}"
            if np.any(np.isinf(columns[key])):
                row = int(np.flatnonzero(np.isinf(columns[key]))[0])
                raise BadRecording(f"{path.name}: {_where(path, row)}: {key} is infinite")
            return key
    near = [key for key in columns if key == letter or key.rpartition("_")[0] == letter]
    units = ", ".join(f"{letter}_{unit}" for unit in UNIT_NAMES)
    if near and (required or letter == "y"):
        raise BadRecording(
            f"{path.name}: {near[0]} is not a {what} in a unit that is known; rename it to one of "
            f"{units} and convert the numbers"
        )
    if required:
        raise BadRecording(f"{path.name}: no {what} column ({units}); there are {_listed(columns)}")
    return ""


def _where(path: Path, row: int) -> str:
    return f"line {line_of_row(path, row)}" if path.suffix in (".csv", ".gz") else f"sample {row}"


def _listed(columns: Mapping[str, Floats]) -> str:
    names = [key[:30] for key in itertools.islice(columns, 8)]
    return ", ".join(names) + (", ..." if len(columns) > 8 else "")


def _sha256(path: Path) -> str:
    with path.open("rb") as handle:
        return hashlib.file_digest(handle, "sha256").hexdigest()
