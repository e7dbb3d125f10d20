"""Read each kind of file with the library made for it. Runs in a separate process
(dehyst.daemon.files.foreign.apart); each library is imported where it is used."""

from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np

from dehyst.daemon.files.csv_table import MOST_BYTES
from dehyst.daemon.files.foreign.arrays import flattened, found_in
from dehyst.daemon.files.foreign.found import Column, Sheet, text_of
from dehyst.daemon.files.foreign.grid import LOOKED_AT, fill, lay_out
from dehyst.daemon.files.foreign.units import TIME, UNITS, find_unit_key
from dehyst.models.errors import BadRecording

MOST_ROWS = 4_000_000


def read_mat(path: Path) -> Sheet:
    """Read a MATLAB file: up to version 7 with scipy, version 7.3 with h5py."""
    from scipy.io import loadmat

    with path.open("rb") as file:
        head = file.read(1024)
    if head.startswith(b"\x89HDF") or b"MATLAB 7.3" in head:
        return read_hdf5(path)
    read = loadmat(path, simplify_cells=True)
    flat = flattened({k: v for k, v in read.items() if k[:2] != "__"})
    return found_in(((name, "", value) for name, value in flat), {})


def read_hdf5(path: Path) -> Sheet:
    """Read an HDF5 file, including MATLAB's."""
    import h5py

    notes: dict[str, str] = {}
    arrays: list[tuple[str, str, Any]] = []
    size = 0

    def visit(given: str | bytes, item: Any) -> None:
        nonlocal size
        name = text_of(given)
        if not isinstance(item, h5py.Dataset) or "#refs#" in name or "#subsystem#" in name:
            return
        kind = item.attrs.get("MATLAB_class", b"")
        if item.shape is None:  # a dataset without a value
            return
        if item.attrs.get("MATLAB_empty", 0) or kind in (b"cell", b"function_handle"):
            return
        size += item.size * max(item.dtype.itemsize, 1)
        if size > MOST_BYTES:
            raise BadRecording(f"holds more than {MOST_BYTES >> 20} MB; cut it into several files")
        if kind == b"char":
            letters = np.asarray(item[()]).reshape(-1)[:200].astype("<u2")
            notes[name] = letters.tobytes().decode("utf-16-le", "replace")
        elif h5py.check_string_dtype(item.dtype):
            if item.size == 1:
                notes[name] = text_of(np.asarray(item[()]).reshape(-1)[0])[:200]
        elif item.dtype.kind in "biuf" or item.dtype.names:
            unit, values = _as_scaled(item.attrs, item[()])
            arrays.append((name, unit, values))

    with h5py.File(path, "r") as file:
        file.visititems(visit)
        for key, value in file.attrs.items():
            if isinstance(value, str | int | float | np.number):
                notes[str(key)] = str(value)[:200]
    return found_in(arrays, notes)


def _unit_in(attributes: Any) -> str:
    for key in ("unit", "units", "Unit", "Units", "unit_string", "UNIT"):
        value = attributes.get(key)
        if isinstance(value, np.ndarray) and value.size == 1:  # a list of one text
            value = value.reshape(-1)[0]
        if value is not None:
            return text_of(value if isinstance(value, bytes) else str(value))[:40]
    return ""


def _number_in(attributes: Any, *names: str) -> float | None:
    """Return the first of these attributes that is one number, None if none is."""
    for name in names:
        value = np.asarray(attributes.get(name, ""))
        if value.size == 1 and value.dtype.kind in "iuf":
            return float(value.reshape(-1)[0])
    return None


def _as_scaled(attributes: Any, values: Any) -> tuple[str, Any]:
    """Return (unit, values) of a dataset as the CF conventions unpack it: `_FillValue` is missing,
    and the rest times `scale_factor` plus `add_offset`. A factor of another convention is put into
    the unit, which is then asked for."""
    unit = _unit_in(attributes)
    if values.dtype.kind not in "iuf":
        return unit, values
    missing = [_number_in(attributes, name) for name in ("_FillValue", "missing_value")]
    factor, offset = (_number_in(attributes, name) for name in ("scale_factor", "add_offset"))
    known = [value for value in missing if value is not None and np.any(values == value)]
    if known or factor is not None or offset is not None:
        lost = np.isin(values, known)
        values = values * (1.0 if factor is None else factor) + (offset or 0.0)
        values[lost] = np.nan
    other = _number_in(attributes, "scaling_factor", "scale", "gain")
    other, zero = 1.0 if other is None else other, _number_in(attributes, "offset") or 0.0
    if (other, zero) != (1.0, 0.0):
        unit = f"{unit} x {other:g}" + (f" + {zero:g}" if zero else "")
    return unit.strip(), values


def read_xlsx(path: Path) -> Sheet:
    """Read the sheets of a spreadsheet; headings are `Sheet/Heading` if several sheets hold
    numbers."""
    from openpyxl import load_workbook

    book = load_workbook(path, read_only=True, data_only=True)
    sheets: list[tuple[str, Sheet]] = []
    refused: list[BadRecording] = []
    formulas = False
    for sheet in book.worksheets:
        rows = []
        for row in sheet.iter_rows(values_only=True, max_col=512):
            rows.append(row)
            if len(rows) > MOST_ROWS:
                raise BadRecording(f"{sheet.title}: more than {MOST_ROWS} rows")
        looked = [row for row in rows if any(cell is not None for cell in row)][:LOOKED_AT]
        if not looked:
            continue
        begins = next(i for i, row in enumerate(rows) if row is looked[0])
        try:
            layout = lay_out(sheet.title, looked, ".")
        except BadRecording:
            formulas = True
            continue
        first = next(i for i in range(begins, len(rows)) if rows[i] is looked[layout.first])
        places = ((i, rows[i]) for i in range(first, len(rows)))
        try:
            here = fill(sheet.title, layout, places, lambda place: f"row {place + 1}")
        except BadRecording as error:
            refused.append(error)
            continue
        if len(here.columns) > 1 and here.columns[0].values.size > 1:
            sheets.append((sheet.title, here))
    if not sheets:
        if refused:
            raise refused[0]
        raise BadRecording(
            "no sheet holds columns of numbers"
            + (" (formulas that were never computed count as empty)" if formulas else "")
        )
    if len(sheets) == 1:
        found = sheets[0][1]
        if len(book.sheetnames) > 1:
            found.said.append(f"from the sheet '{sheets[0][0]}'")
    else:
        found = Sheet(
            [
                Column(f"{title}/{c.heading}", c.values, c.unit, c.clock)
                for title, one in sheets
                for c in one.columns
            ]
        )
        for title, one in sheets:
            found.notes |= {f"{title}/{key}": text for key, text in one.notes.items()}
    found.said += [f"sheet left out: {str(error)[:200]}" for error in refused]
    found.where = lambda row: f"row {row + 1}"
    return found


def read_tdms(path: Path) -> Sheet:
    """Read a LabVIEW TDMS file; headings are `Group/Channel` if there are several groups."""
    from nptdms import TdmsFile

    notes: dict[str, str] = {}
    steps: set[float] = set()
    starts: set[float] = set()
    with TdmsFile.open(path) as file:
        groups = file.groups()
        notes |= {str(k): str(v)[:200] for k, v in file.properties.items() if str(v)}

        def channels() -> Iterator[tuple[str, str, Any]]:
            size = 0
            for group in groups:
                for channel in group.channels():
                    size += 8 * len(channel)
                    if size > MOST_BYTES:
                        raise BadRecording(f"holds more than {MOST_BYTES >> 20} MB")
                    name = f"{group.name}/{channel.name}" if len(groups) > 1 else channel.name
                    step = channel.properties.get("wf_increment", 0.0)
                    along = str(channel.properties.get("wf_xunit_string", "") or "s")
                    kind, _, factor = UNITS.get(find_unit_key(along), ("", "", 0.0))
                    if kind == TIME and isinstance(step, float | int) and 0 < step < 1e6:
                        steps.add(factor * float(step))
                        start = float(channel.properties.get("wf_start_offset", 0.0))
                        starts.add(factor * start)
                    yield name, _unit_in(channel.properties), channel[:]

        found = found_in(channels(), notes)
    if len(steps) == 1 and len(starts) == 1:
        found.step_s, found.start_s = steps.pop(), starts.pop()
    return found


def read_parquet(path: Path) -> Sheet:
    """Read a Parquet file; nested columns are named by their path."""
    import pyarrow.parquet

    file = pyarrow.parquet.ParquetFile(path)
    if 8 * file.metadata.num_rows * file.metadata.num_columns > MOST_BYTES:
        raise BadRecording(f"holds more than {MOST_BYTES >> 20} MB; cut it into several files")
    table = file.read()
    while any(pyarrow.types.is_struct(field.type) for field in table.schema):
        table = table.flatten()
    plain = (
        (name, "", column.to_numpy())
        for name, column in zip(table.column_names, table.columns, strict=True)
    )
    return found_in(plain, {})


READERS: dict[str, Callable[[Path], Sheet]] = {
    ".mat": read_mat,
    ".h5": read_hdf5,
    ".hdf5": read_hdf5,
    ".xlsx": read_xlsx,
    ".tdms": read_tdms,
    ".parquet": read_parquet,
}
