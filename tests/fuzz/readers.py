"""Files that a library reads, each kind as its own target.

The product starts a process for each such file, which takes a second; here it is a fork of this
process, which has the libraries loaded and reads one file after another until one ends it.
Everything else is the product's own code: the bounds, the answer and its evaluation.
"""

import io
import json
import os
import resource
import signal
import subprocess
import sys
import tempfile
import traceback
import zipfile
from collections.abc import Callable
from functools import partial
from importlib import import_module
from pathlib import Path
from typing import Any

import numpy as np
from tests.fuzz import files

from dehyst.daemon.files.foreign.containers import apart, libraries
from dehyst.daemon.files.foreign.found import Sheet
from dehyst.drivers import system
from dehyst.models.errors import BadRecording

LONGEST_S = 2
"""Limit of processor time [s] for a file of at most 64 KB, a fifth of the product's limit."""
OWN_FAULT = 99
MOST_FILES = 500
"""Most files that one process reads: memory that libraries leak on damaged files accumulates."""
IN_PIECES = 128
PART = b"\n--part "
"""Precedes the name of a member of an archive that is given in pieces."""
T, U, Y = files.T, files.U, files.Y
COLUMNS = {"t_s": T, "u_v": U, "y_um": Y}


class OwnFault(Exception):
    """The error came from a line of dehyst, not from the library."""


class Reader:
    """A fork of this process that reads files one after another, until one of them ends it."""

    def __init__(self) -> None:
        self.said = [tempfile.TemporaryFile(buffering=0), tempfile.TemporaryFile(buffering=0)]  # noqa: SIM115 - kept
        (asked, self._ask), (self._answer, answered) = os.pipe(), os.pipe()
        self.left = MOST_FILES
        self.child = os.fork()
        if not self.child:
            os.close(self._ask)
            os.close(self._answer)
            self._serve(asked, answered)
        os.close(asked)
        os.close(answered)

    def _serve(self, asked: int, answered: int) -> None:
        """Read files on request; never return."""
        try:
            for number, file in enumerate(self.said, 1):
                os.dup2(file.fileno(), number)
            sys.stdout, sys.stderr = os.fdopen(1, "w"), os.fdopen(2, "w")
            resource.setrlimit(resource.RLIMIT_CORE, (0, 0))
            signal.signal(signal.SIGPROF, signal.SIG_DFL)
            system.bound_processor_time = lambda _: None  # it counts from the start of a process
            readers = libraries.READERS
            for kind, read in list(readers.items()):
                readers[kind] = partial(_judged, read)
            while request := os.read(asked, 4096).decode():
                signal.setitimer(signal.ITIMER_PROF, LONGEST_S)
                code = _read(*request.split("\n"))
                signal.setitimer(signal.ITIMER_PROF, 0)
                os.write(answered, bytes([code]))
        finally:
            os._exit(1)

    def read(self, path: Path, target: Path) -> subprocess.CompletedProcess[str]:
        """Read one file and return the outcome."""
        for file in self.said:  # the child shares the file positions
            file.seek(0)
            file.truncate()
        os.write(self._ask, f"{path}\n{target}".encode())
        answer = os.read(self._answer, 1)
        self.left -= 1
        code = answer[0] if answer else self.end()
        texts = []
        for file in self.said:
            file.seek(0)
            texts.append(file.read().decode(errors="replace"))
        if code == -signal.SIGPROF:
            code = apart.ENDED_BY_TIME
        if code == OWN_FAULT:
            raise OwnFault(" ".join(texts[1].split())[-400:])
        return subprocess.CompletedProcess([], code, *texts)

    def end(self) -> int:
        """End the child and return its exit status, negative for a signal."""
        self.left = 0
        os.close(self._ask)
        os.close(self._answer)
        return os.waitstatus_to_exitcode(os.waitpid(self.child, 0)[1])


_running: list[Reader] = []


def read_in_fork(path: Path, target: Path) -> subprocess.CompletedProcess[str]:
    """Replaces apart.start_reader."""
    if _running and not _running[0].left:
        for file in _running.pop().said:
            file.close()
    if not _running:
        _running.append(Reader())
    reader = _running[0]
    done = reader.read(path, target)
    if reader.left == 0 and done.returncode >= 0:
        reader.end()
    return done


def _read(path: str, target: str) -> int:
    """Return the exit status that a process would have had."""
    code = 0
    try:
        apart.main(path, target)
    except SystemExit as error:
        code = error.code if isinstance(error.code, int) else 1
    except Exception:
        traceback.print_exc()
        code = 1
    sys.stdout.flush()
    sys.stderr.flush()
    return code


def _judged(read: Callable[[Path], Sheet], path: Path) -> Sheet:
    """Call the reader, and report errors in dehyst's own code separately."""
    try:
        return read(path)
    except (BadRecording, MemoryError):
        raise
    except Exception as error:
        last = traceback.extract_tb(error.__traceback__)[-1]
        if "/dehyst/" in last.filename:
            where = f"{Path(last.filename).name}:{last.lineno}"
            print(f"{type(error).__name__}: {error} in {where}", file=sys.stderr, flush=True)
            raise SystemExit(OWN_FAULT) from None
        raise


def reader_of(suffix: str) -> Callable[[bytes], bool]:
    """Return the target of one kind. The first byte selects how it is read, what the user says
    about it and, for an archive, whether its members follow in pieces."""

    def run(data: bytes) -> bool:
        if not data:
            return False
        kind, inside = data[0], data[1:]
        if suffix == ".xlsx" and kind >= IN_PIECES:
            inside = packed(inside)
        path = files.FOLDER / f"a{suffix}"
        path.unlink(missing_ok=True)  # otherwise h5py reuses the previous file, still open
        path.write_bytes(inside)
        reading = files.READINGS[kind % len(files.READINGS)]
        return files.tables(path, reading, files.READERS[kind // len(files.READINGS) % 2 :][:1])

    return run


def packed(data: bytes) -> bytes:
    """Return an archive of the members in `data`, with correct checksums."""
    out = io.BytesIO()
    with zipfile.ZipFile(out, "w") as archive:
        for part in data.split(PART)[1:]:
            name, _, inside = part.partition(b"\n")
            info = zipfile.ZipInfo(name.decode("latin-1").split("\0")[0][:99] or "x")
            if info.filename not in archive.namelist():
                archive.writestr(info, inside)
    return out.getvalue()


def unpacked(data: bytes) -> bytes:
    """Return the members of an archive in pieces."""
    with zipfile.ZipFile(io.BytesIO(data)) as archive:
        return b"".join(PART + n.encode() + b"\n" + archive.read(n) for n in archive.namelist())


def _written(name: str, write: Callable[[Path], object]) -> bytes:
    path = files.FOLDER / name
    write(path)
    data = path.read_bytes()
    path.unlink()
    return data


def mat_seeds() -> tuple[bytes, ...]:
    """Return versions 4, 6, 7 and 7.3 (HDF5 after MATLAB's header); plain, nested, with texts."""
    from scipy.io import savemat

    nested = {"run": {**COLUMNS, "note": "slow", "cells": np.array([1, "b"], dtype=object)}}
    kinds: tuple[tuple[Any, dict[str, Any]], ...] = (
        (COLUMNS, {}), (COLUMNS, {"do_compression": True}), (COLUMNS, {"format": "4"}),
        (nested, {}), ({"y": np.stack([T, U, Y], axis=1), "z": T + 1j, "ok": T > 1}, {}),
    )  # fmt: skip
    made = [_written("s.mat", lambda p, k=k: savemat(p, k[0], **k[1])) for k in kinds]

    def seven(path: Path) -> None:
        import h5py

        with h5py.File(path, "w", userblock_size=512) as one:
            for name, values in COLUMNS.items():
                one[name] = values.reshape(1, -1)
                one[name].attrs["MATLAB_class"] = np.bytes_("double")
            one["note"] = np.array([[115], [108]], dtype="u2")
            one["note"].attrs["MATLAB_class"] = np.bytes_("char")
            one["none"] = np.zeros(2, "u8")
            one["none"].attrs["MATLAB_empty"] = 1
        head = b"MATLAB 7.3 MAT-file, Platform: GLNXA64".ljust(124) + b"\0\2IM"
        with path.open("r+b") as file:
            file.write(head)

    return tuple(b"\0" + data for data in (*made, _written("s.mat", seven)))


def hdf5_seeds() -> tuple[bytes, ...]:
    """Return the old and new file layout, with groups, units, texts, compressed and empty ones."""
    import h5py

    def write(path: Path, **layout: Any) -> None:
        with h5py.File(path, "w", **layout) as one:
            for name, values in COLUMNS.items():
                one[f"run/{name}"] = values
            one["run/u_v"].attrs["unit"] = "V"
            one.attrs["stage"] = "P-885"

    def many(path: Path) -> None:
        with h5py.File(path, "w") as one:
            one.create_dataset("Time", data=T, chunks=(10,), compression="gzip", shuffle=True)
            one.create_dataset("Voltage", data=U, chunks=(10,), fletcher32=True)
            one.create_dataset("Weg", data=Y.astype(">i2"), maxshape=(None,))
            one["Weg"].attrs["units"] = np.bytes_("um")
            one["note"] = "slow"
            one["empty"] = h5py.Empty("f8")
            one["alias"] = h5py.SoftLink("/Weg")

    def rows(path: Path) -> None:
        table = np.zeros(30, [("t_s", "f8"), ("u_v", "f4"), ("y_um", "i2")])
        table["t_s"] = T
        with h5py.File(path, "w") as one:
            one["table"] = table

    made = (
        _written("s.h5", write), _written("s.h5", lambda p: write(p, libver="latest")),
        _written("s.h5", many), _written("s.h5", rows),
    )  # fmt: skip
    return tuple(b"\0" + data for data in made)


def xlsx_seeds() -> tuple[bytes, ...]:
    """Return a sheet, and two with a preamble, a clock and a formula; packed, and in pieces."""
    from datetime import datetime, timedelta

    import openpyxl

    def plain(path: Path) -> None:
        book = openpyxl.Workbook()
        book.active.append(list(COLUMNS))
        for row in zip(T, U, Y, strict=True):
            book.active.append([float(x) for x in row])
        book.save(path)

    def rich(path: Path) -> None:
        book = openpyxl.Workbook()
        first, begin = book.active, datetime(2024, 3, 5, 12)
        first.append(["Stage", "P-885"])
        first.append(["Zeit", "Spannung", "Weg"])
        first.append(["s", "V", "um"])
        for i in range(10):
            first.append([begin + timedelta(seconds=i), i % 7, i % 5, "=B4+1", i > 3])
        second = book.create_sheet("Second")
        second.append(["Time (ms)", "y_um"])
        for i in range(10):
            second.append([i, None if i == 3 else i])
        book.save(path)

    made = (_written("s.xlsx", plain), _written("s.xlsx", rich))
    return (
        *(b"\0" + data for data in made),
        *(bytes([IN_PIECES]) + unpacked(data) for data in made),
    )


def tdms_seeds() -> tuple[bytes, ...]:
    """Return times as a channel, as a waveform's period, as dates; several segments and groups."""
    from nptdms import ChannelObject, GroupObject, RootObject, TdmsWriter

    def plain(path: Path) -> None:
        with TdmsWriter(path) as writer:
            for t_s in (T, T + 0.03):
                columns = {**COLUMNS, "t_s": t_s}
                writer.write_segment([ChannelObject("g", n, v) for n, v in columns.items()])

    def wave(path: Path) -> None:
        of_wave = {"wf_increment": 1e-3, "wf_start_offset": 0.5, "unit_string": "V"}
        with TdmsWriter(path) as writer:
            writer.write_segment(
                [
                    RootObject({"stage": "P-885", "begun": np.datetime64("2024-03-05T12:00:00")}),
                    GroupObject("g", {"gain": 1.5}),
                    ChannelObject("g", "drive", U, of_wave),
                    ChannelObject("g", "y", Y.astype("i2"), {**of_wave, "unit_string": "um"}),
                    ChannelObject("h", "words", ["a", "bc"]),
                ]
            )

    def clock(path: Path) -> None:
        moments = np.datetime64("2024-03-05T12:00:00") + np.arange(30) * np.timedelta64(1000, "us")
        with TdmsWriter(path) as writer:
            writer.write_segment(
                [ChannelObject("g", "Time", moments), ChannelObject("g", "y_um", Y)]
            )

    return tuple(b"\0" + _written("s.tdms", write) for write in (plain, wave, clock))


def parquet_seeds() -> tuple[bytes, ...]:
    """Return plain and packed tables, with dates, missing values, texts and nested columns."""
    import pyarrow as pa
    from pyarrow.parquet import write_table

    plain = pa.table({name: list(values) for name, values in COLUMNS.items()})
    rich = pa.table(
        {
            "Time": pa.array(np.datetime64("2024-03-05T12:00") + np.arange(30).astype("m8[ms]")),
            "run": [{"u_v": float(u), "inner": {"y_um": float(y)}} for u, y in zip(U, Y, strict=1)],
            "gap": [None if i % 4 else i for i in range(30)],
            "note": ["a"] * 30,
            "list": [[1.0, 2.0]] * 30,
        }
    )
    ways: tuple[tuple[Any, dict[str, Any]], ...] = (
        (plain, {"compression": "none", "use_dictionary": False}),
        (plain, {"compression": "snappy", "data_page_version": "2.0"}),
        (plain, {"compression": "gzip", "write_page_checksum": True}),
        (rich, {"compression": "none"}),
    )
    return tuple(
        b"\0" + _written("s.parquet", lambda p, w=w: write_table(w[0], p, **w[1])) for w in ways
    )


def json_seeds() -> tuple[bytes, ...]:
    """Return columns, rows, rows by number, and a matrix next to its names, with gaps."""
    rows = [dict(zip(COLUMNS, row, strict=True)) for row in zip(*COLUMNS.values(), strict=True)]
    rows = [{key: float(value) for key, value in row.items()} for row in rows]
    values: tuple[Any, ...] = (
        {name: [float(v) for v in column] for name, column in COLUMNS.items()},
        rows,
        {name: {str(i): row[name] for i, row in enumerate(rows)} for name in COLUMNS},
        {"columns": list(COLUMNS), "data": [list(row.values()) for row in rows], "fs": 1e3},
        {"gap": [None, 1.0] * 15, "t": [f"12:00:{i:02d}" for i in range(30)], "a": {"b": [[1]]}},
    )
    return tuple(b"\0" + json.dumps(value).encode() for value in values)


def feather_seeds() -> tuple[bytes, ...]:
    """Return tables of both versions of the format."""
    import pyarrow as pa
    from pyarrow.feather import write_feather

    table = pa.table({name: list(values) for name, values in COLUMNS.items()})
    ways: tuple[dict[str, Any], ...] = (
        {"version": 1},
        {"version": 2, "compression": "uncompressed"},
        {"version": 2, "compression": "zstd"},
    )
    return tuple(
        b"\0" + _written("s.feather", lambda p, w=w: write_feather(table, p, **w)) for w in ways
    )


SEEDS: dict[str, Callable[[], tuple[bytes, ...]]] = {
    ".mat": mat_seeds,
    ".h5": hdf5_seeds,
    ".xlsx": xlsx_seeds,
    ".tdms": tdms_seeds,
    ".parquet": parquet_seeds,
    ".feather": feather_seeds,
    ".json": json_seeds,
}
WORDS: dict[str, tuple[bytes, ...]] = {
    ".mat": (b"\x0e\0\0\0", b"\x0f\0\0\0", b"\x05\0\4\0", b"MATLAB 7.3", b"\xff\xff\xff\x7f"),
    ".h5": (b"\x89HDF\r\n\x1a\n", b"TREE", b"HEAP", b"SNOD", b"OHDR", b"\xff" * 8, b"\0" * 8),
    ".xlsx": (
        PART, b"<row>", b'<c r="A1"><v>1</v></c>', b't="s"', b't="d"', b't="e"', b"1e999", b"nan",
        b'r="XFD1048576"', b"<!DOCTYPE a [<!ENTITY b 'c'>]>", b"&b;", b"99999999999", b"\0",
    ),
    ".tdms": (b"TDSm", b"\x69\x12\0\0", b"\xff" * 8, b"\x20\0\0\0", b"\x44\0\0\0", b"\0" * 8),
    ".parquet": (b"PAR1", b"\x15\x02", b"\x15\xfe\xff\xff\xff\x0f", b"\x80" * 9 + b"\1", b"\0" * 4),
    ".feather": (b"ARROW1", b"FEA1", b"\xff\xff\xff\xff", b"\x10\0\0\0", b"\0" * 8),
    ".json": (b"null", b"NaN", b"1e999", b"{}", b"[]", b'"t_s"', b'"12:00:01"', b"[[", b"9" * 400),
}  # fmt: skip


def seeds_of(suffix: str) -> tuple[bytes, ...]:
    """Return the valid files of a kind, and the first one with every option of a user."""
    made = SEEDS[suffix]()
    ways = len(files.READINGS) * len(files.READERS)
    return (*made, *(bytes([i]) + made[0][1:] for i in range(1, ways)))


def load_libraries() -> None:
    """Load the libraries into this process, as the reader does before it limits itself."""
    for _, library, _ in apart.NEEDS.values():
        import_module(library)
    for name in ("scipy.io", "scipy.io.matlab", "pyarrow.parquet"):
        import_module(name)
    apart.start_reader = read_in_fork
