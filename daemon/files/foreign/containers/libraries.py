"""Read each kind of file with the library made for it. Runs in a separate process
(dehyst.daemon.files.foreign.containers.apart); each library is imported where it is used."""

import re
from collections.abc import Callable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from dehyst.daemon.files.csv_table import MOST_BYTES
from dehyst.daemon.files.foreign.beside import names_beside
from dehyst.daemon.files.foreign.containers.arrays import (
    MOST_DEEP,
    MOST_WIDE,
    by_columns,
    flattened,
    found_in,
    texts_in,
)
from dehyst.daemon.files.foreign.containers.attributes import (
    as_scaled,
    moment_in,
    remarks,
    text_in,
    unit_in,
    wave_in,
)
from dehyst.daemon.files.foreign.found import Column, Given, Sheet, text_of
from dehyst.daemon.files.foreign.grid import LOOKED_AT, TURNED, fill, lay_out
from dehyst.daemon.files.foreign.runs import note_below, notes_in, rows_below
from dehyst.daemon.files.foreign.text import understand_text
from dehyst.models.errors import BadRecording

MOST_ROWS = 4_000_000
_PICKLED_NAME = re.compile(r"^a?V(.+)$", re.MULTILINE)
"""A name in a list of names, as pandas writes it into an attribute."""
LAYOUTS = {"pandas", "ARROW:schema", "huggingface", "geo"}
"""Keys under which programs keep the layout of a table."""


def read_mat(path: Path) -> Sheet:
    """Read a MATLAB file: up to version 7 with scipy, version 7.3 with h5py."""
    from scipy.io import loadmat, matlab

    with path.open("rb") as file:
        head = file.read(1024)
    if head.startswith(b"\x89HDF") or b"MATLAB 7.3" in head:
        return read_hdf5(path)
    read = loadmat(path, simplify_cells=True)
    objects: dict[str, str] = {}
    plain: list[Given] = []
    for name, value in flattened({k: v for k, v in read.items() if k[:2] != "__"}):
        if isinstance(value, matlab.MatlabOpaque | matlab.MatlabObject):
            objects[name] = str(getattr(value, "classname", "") or "object")
        else:
            plain.append(Given(name, value))
    return _without_objects(found_in(plain, {}), objects)


def _without_objects(found: Sheet, objects: Mapping[str, str]) -> Sheet:
    """Say which objects of MATLAB were left out, by name and class: their numbers are stored in a
    form that only MATLAB knows."""
    if objects:
        names = ", ".join(f"{name} ({kind})" for name, kind in list(objects.items())[:5])
        found.said.append(
            f"objects that only MATLAB reads are left out: {names}; save their numbers as arrays "
            "or structures, such as u = u.Data of a timeseries"
        )
    return found


def read_hdf5(path: Path) -> Sheet:
    """Read an HDF5 file, including MATLAB's, whose cells and arrays of structures are lists of
    references."""
    import h5py

    notes: dict[str, str] = {}
    arrays: list[Given] = []
    objects: dict[str, str] = {}
    size = 0

    def visit(given: str | bytes, item: Any) -> None:
        name = text_of(given)
        if not any(own in f"/{name}" for own in ("#refs#", "#subsystem#", "/_i_")):
            take(name, item, 0)

    def take(name: str, item: Any, deep: int) -> None:
        nonlocal size
        kind = text_of(item.attrs.get("MATLAB_class", b""))
        if "MATLAB_object_decode" in item.attrs and kind not in ("", "function_handle"):
            objects[name] = kind
            return
        whole = not isinstance(item, h5py.Dataset)  # a group
        notes.update(remarks(f"{name}{'/' if whole else '.'}", item.attrs))
        if whole:
            if deep:
                item.visititems(lambda inner, one: take(f"{name}/{text_of(inner)}", one, deep))
            return
        if item.shape is None:  # a dataset without a value
            return
        if item.attrs.get("MATLAB_empty", 0) or kind == "function_handle":
            return
        try:
            size += item.size * max(item.dtype.itemsize, 1)
        except TypeError:  # the dataset, or a field of the table, has no equal in numpy
            raise BadRecording(
                f"{name} has a type that h5py does not read, such as HDF5's own type of times: "
                "save its columns as numbers (PyTables: Float64Col instead of Time64Col)"
            ) from None
        if size > MOST_BYTES:
            raise BadRecording(f"holds more than {MOST_BYTES >> 20} MB; cut it into several files")
        if h5py.check_ref_dtype(item.dtype) is h5py.Reference:
            if item.size <= MOST_WIDE and deep < MOST_DEEP:
                follow(name, kind, [item.file[ref] for ref in item[()].reshape(-1) if ref], deep)
        elif kind == "char":
            notes[name] = characters(item)
        elif h5py.check_string_dtype(item.dtype) or item.dtype.kind in "biufS" or item.dtype.names:
            arrays.extend(_given(name, item))

    def characters(item: Any) -> str:
        letters = np.asarray(item[()]).T.reshape(-1)[:200].astype("<u2")
        return letters.tobytes().decode("utf-16-le", "replace")

    def follow(name: str, kind: str, items: Sequence[Any], deep: int) -> None:
        """Take the targets of the references in a cell, or in one field of an array of
        structures."""
        kinds = {text_of(item.attrs.get("MATLAB_class", b"")) for item in items}
        if kinds == {"char"} and kind == "cell":
            arrays.append(Given(name, np.array([characters(item) for item in items])))
            return
        group, _, last = name.rpartition("/")
        values = [item[()] for item in items if isinstance(item, h5py.Dataset)]
        if kind == "cell" and len(values) == len(items) > 1 and kinds <= {"double", "single"}:
            whole = list(flattened(values, name))  # columns side by side keep one name
            if len(whole) == 1:
                arrays.append(Given(*whole[0]))
                return
        for i, item in enumerate(items):
            inside = f"{name}/{i}" if kind == "cell" else f"{group}/{i}/{last}".lstrip("/")
            take(inside if len(items) > 1 else name, item, deep + 1)

    with h5py.File(path, "r") as file:
        file.visititems(visit)
        notes |= remarks("", file.attrs)
    return _without_objects(found_in(arrays, notes), objects)


def _given(name: str, item: Any) -> list[Given]:
    """Return a dataset, or the fields of a table, with the names and units in its attributes."""
    if item.dtype.names:
        table = item[()]
        kinds = {field: text_in(item.attrs, f"{field}_kind") for field in item.dtype.names}
        named = {key: _PICKLED_NAME.findall(kind) for key, kind in kinds.items()}
        return [Given(f"{name}.{key}", table[key], names=names) for key, names in named.items()]
    if item.dtype.kind not in "iuf":
        return [Given(name, item[()])]
    unit, values = as_scaled(item.attrs, item[()])
    label = text_in(item.attrs, "long_name", "label", "name")[:60]
    width = sorted(item.shape)[-2] if item.ndim == 2 else 0
    lists = {
        text_of(key): texts
        for key, value in item.attrs.items()
        if width and (texts := texts_in(np.asarray(value)))
    }
    names, units = names_beside("", width, lists)
    return [Given(name, values, "" if units else unit, label, names, units)]


def read_xlsx(path: Path) -> Sheet:
    """Read the sheets of a spreadsheet; headings are `Sheet/Heading` if several sheets hold
    numbers."""
    from openpyxl import load_workbook

    with path.open("rb") as file:
        if file.read(4) == b"\xd0\xcf\x11\xe0":
            raise BadRecording(
                "is protected by a password, or an Excel 97 file: save it as .xlsx without a "
                "password"
            )
    book = load_workbook(path, read_only=True, data_only=True)
    sheets: list[tuple[str, Sheet]] = []
    refused: list[BadRecording] = []
    unread: list[BadRecording] = []
    below: list[str] = []
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
        left, notes = "", dict[str, str]()
        if size := rows_below(rows, "."):
            notes = notes_in(rows[-size:])
            left = note_below(rows[-size:], f"row {len(rows) - size + 1}")
            del rows[-size:]
            looked = [row for row in rows if any(cell is not None for cell in row)][:LOOKED_AT]
        try:
            if all(sum(cell is not None for cell in row) == 1 for row in looked):
                sheets.append((sheet.title, understand_text(sheet.title, _lines_in(rows))))
                continue
            layout = lay_out(sheet.title, looked, ".")
            layout.remarks = notes
        except BadRecording as error:
            unread.append(error)
            continue
        first = next(i for i in range(begins, len(rows)) if rows[i] is looked[layout.first])
        places = ((i, rows[i]) for i in range(first, len(rows)))
        try:
            here = fill(sheet.title, layout, places, lambda place: f"row {place + 1}")
        except BadRecording as error:
            refused.append(error)
            continue
        if left:
            here.said.append(left)
            below.append(f"{sheet.title}: {left}")
        if len(here.columns) > 1 and here.columns[0].values.size > 1:
            sheets.append((sheet.title, here))
    if not sheets:
        if refused:
            raise refused[0]
        if wide := next((error for error in unread if TURNED in str(error)), None):
            raise wide
        raise BadRecording(
            "no sheet holds columns of numbers"
            + (" (formulas that were never computed count as empty)" if unread else "")
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
        found.said += below
        for title, one in sheets:
            found.notes |= {f"{title}/{key}": text for key, text in one.notes.items()}
            found.blank |= {f"{title}/{heading}": text for heading, text in one.blank.items()}
            found.factor = found.factor or one.factor
    found.said += [f"sheet left out: {str(error)[:200]}" for error in refused]
    found.where = lambda row: f"row {row + 1}"
    return found


def _lines_in(rows: Sequence[Sequence[Any]]) -> str:
    """Return a text that was opened with the wrong separator: each line is in one cell."""
    return "\n".join(next((str(cell) for cell in row if cell is not None), "") for row in rows)


def read_tdms(path: Path) -> Sheet:
    """Read a LabVIEW TDMS file; headings are `Group/Channel` if there are several groups."""
    from nptdms import TdmsFile

    notes: dict[str, str] = {}
    with TdmsFile.open(path) as file:
        groups = file.groups()
        notes |= {str(k): str(v)[:200] for k, v in file.properties.items() if str(v)}

        every = [channel for group in groups for channel in group.channels()]
        begins = [at for c in every if (at := moment_in(c.properties)) is not None]
        first = min(begins, default=None)

        def channels() -> Iterator[Given]:
            size = 0
            for group in groups:
                for channel in group.channels():
                    name = f"{group.name}/{channel.name}" if len(groups) > 1 else channel.name
                    notes.update(remarks(f"{name}.", channel.properties))
                    size += 8 * len(channel)
                    if size > MOST_BYTES:
                        raise BadRecording(f"holds more than {MOST_BYTES >> 20} MB")
                    wave = wave_in(channel.properties, first)
                    yield Given(name, channel[:], unit_in(channel.properties), wave=wave)

        found = found_in(list(channels()), notes)
    found.start_s = min((c.wave[0] for c in found.columns if c.wave), default=0.0)
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
    return _of_table(table)


def read_feather(path: Path) -> Sheet:
    """Read a Feather file."""
    import pyarrow.feather

    return _of_table(pyarrow.feather.read_table(path))


def _of_table(table: Any) -> Sheet:
    """Return the columns of an Arrow table. What other programs write into its metadata, apart from
    their own layouts, becomes notes."""
    beside = {text_of(k): text_of(v)[:200] for k, v in (table.schema.metadata or {}).items()}
    notes = {key: text for key, text in beside.items() if key not in LAYOUTS}
    return found_in(_columns_of(table), notes)


def read_netcdf(path: Path) -> Sheet:
    """Read a netCDF file: version 4 is HDF5, scipy reads version 3."""
    from scipy.io import netcdf_file

    with path.open("rb") as file:
        if file.read(4) == b"\x89HDF":
            return read_hdf5(path)
    with netcdf_file(path, mmap=False) as read:
        notes: dict[str, str] = {}
        for name, variable in read.variables.items():
            notes |= remarks(f"{name}.", vars(variable))
        return found_in(
            (
                Given(name, values, unit)
                for name, variable in read.variables.items()
                for unit, values in [as_scaled(vars(variable), variable[:])]
            ),
            notes,
        )


def read_json(path: Path) -> Sheet:
    """Read JSON, or one JSON value per line, which files named .json may also hold: columns by
    name, or a list of rows."""
    import json

    text = path.read_text("utf-8-sig")
    rows = [row for row in text.splitlines() if row.strip()]
    try:
        value = json.loads(text)
    except json.JSONDecodeError as error:
        if len(rows) < 2 or not error.msg.startswith("Extra data"):
            raise
        value = [json.loads(row) for row in rows]
    return found_in((Given(*one) for one in flattened(by_columns(value))), {})


def _columns_of(table: Any) -> Iterator[Given]:
    """Yield the columns of an Arrow table, with the units in the metadata of its fields."""
    for field, column in zip(table.schema, table.columns, strict=True):
        beside = {text_of(k): text_of(v) for k, v in (field.metadata or {}).items()}
        for name, values in flattened(column.to_numpy(), field.name):
            yield Given(name, values, unit_in(beside))


READERS: dict[str, Callable[[Path], Sheet]] = {
    ".mat": read_mat,
    ".h5": read_hdf5,
    ".hdf5": read_hdf5,
    ".hdf": read_hdf5,
    ".nc": read_netcdf,
    ".xlsx": read_xlsx,
    ".xlsm": read_xlsx,
    ".tdms": read_tdms,
    ".parquet": read_parquet,
    ".feather": read_feather,
    ".json": read_json,
    ".jsonl": read_json,
}
