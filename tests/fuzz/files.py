"""External files as functions of bytes: recordings of every kind, truncated ones, kept cases."""

import os
import tempfile
import warnings
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

from dehyst.daemon.files import cases, recordings
from dehyst.daemon.files.foreign.reading import ReadOptions
from dehyst.daemon.files.rows import open_rows
from dehyst.daemon.files.sidecar import read_notes
from dehyst.models.errors import BadInput

FOLDER = Path(tempfile.mkdtemp(prefix="dehyst-fuzz-", dir="/dev/shm"))
READINGS = (
    ReadOptions(),
    ReadOptions(unit="um"),
    ReadOptions({"t": 0, "u": 1, "y": 2}, unit="nm"),
    ReadOptions({"u": "u", "y": "y"}, rate_hz=1000.0, unit="um"),
    ReadOptions(time_unit="ms"),
)
READERS: tuple[Callable[..., Any], ...] = (recordings.read_recording, recordings.read_trajectory)
GROWN = ("a.csv", "a.csv.gz", "a.npz", "a.mcap")

refusal: list[str] = []
"""The last refusal."""


def file(name: str, data: bytes) -> Path:
    """Write these bytes to a file and return its path."""
    path = FOLDER / name
    path.write_bytes(data)
    return path


def require_one_line(error: BadInput) -> None:
    """Check that the refusal of a file fits into a line."""
    refusal[:] = [str(error)]
    assert "\n" not in str(error)
    assert len(str(error)) < 1000


def _notes(table: Any) -> list[str]:
    return [text for pair in getattr(table, "metadata", {}).items() for text in pair]


def tables(
    path: Path,
    reading: ReadOptions = READINGS[0],
    readers: tuple[Callable[..., Any], ...] = READERS,
) -> bool:
    """Read it as a recording and as a trajectory: only BadInput may occur, and no warning."""
    read = 0
    for reader in readers:
        try:
            with warnings.catch_warnings():
                warnings.simplefilter("error")
                table = reader(path, reading=reading)
        except BadInput as error:
            require_one_line(error)
            continue
        assert np.all(np.isfinite(table.t_s))
        assert np.all(np.diff(table.t_s) > 0)
        words = (table.name, table.read, *table.channels, *_notes(table))
        "".join(map(str, words)).encode()  # as they are written next to a converted file
        read += 1
    return read > 0


def text(data: bytes) -> bool:
    """Read text of another program; the first byte selects what the user says about it."""
    return bool(data) and tables(file("a.txt", data[1:]), READINGS[data[0] % len(READINGS)])


def npy(data: bytes) -> bool:
    """Read a numpy array."""
    return bool(data) and tables(file("a.npy", data[1:]), READINGS[data[0] % len(READINGS)])


def unfinished(data: bytes) -> bool:
    """Read a recording whose writer was killed; the first byte selects its kind."""
    if not data:
        return False
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("error")
            columns, _ = recordings.read_columns(
                file(GROWN[data[0] % len(GROWN)], data[1:]), unfinished=True
            )
    except BadInput as error:
        require_one_line(error)
        return False
    assert np.all(np.diff(columns["t_s"]) > 0)
    return True


def case(data: bytes) -> bool:
    """Read the record that is kept of a mismatch, and the notes next to a recording."""
    kinds = {cases.CASE: cases.Case, cases.EXAMINED: cases.Examined, cases.DECIDED: cases.Decided}
    found = 0
    for name, kind in kinds.items():
        file(name, data)
        found += cases.get_record(FOLDER, name, kind) is not None
    file("b.csv.meta.json", data)
    try:
        read_notes(FOLDER / "b.csv")
    except BadInput as error:
        require_one_line(error)
    return found > 0


T, U, Y = np.arange(30) / 1000, np.arange(30) % 7.0, np.arange(30) % 5.0
TEXTS = (
    b"\0Time (s);Voltage (V);Weg (um)\n0,000;1,5;2\n0,001;1,6;2,1\n0,002;1,7;2,2\n",
    b"\1X,CH1,CH2,Start,Increment\nSequence,VOLT,VOLT,0,1e-3\n0,1,2,\n1,2,3,\n2,3,4,\n",
    b"\2" + "0 1 2\n1 2 3\n".encode("utf-16"),
    b"\3LabVIEW Measurement\t\n***End_of_Header***\nX_Value\tu\ty\n0\t1\t2\n1\t2\t3\n",
    b"\4time,u,y_um\n12:00:01,1,2\n12:00:02,2,3\n",
    b"\4t_s,u_v,y_um\n0,1,2\n0,1,2\n5,3,4\n2,3,4\n",
)


def npy_seeds() -> tuple[bytes, ...]:
    """Return arrays with and without names."""
    path = FOLDER / "seed.npy"
    np.save(path, np.stack([T, U, Y], axis=1))
    plain = path.read_bytes()
    named = np.zeros(30, [("t_s", "f8"), ("u_v", "f4"), ("y_um", "i2")])
    named["t_s"] = T
    np.save(path, named)
    return b"\2" + plain, b"\0" + path.read_bytes()


def grown_seeds() -> tuple[bytes, ...]:
    """Return a file of each kind before it is closed."""
    out: list[bytes] = []
    for i, name in enumerate(GROWN):
        path = FOLDER / name
        path.unlink(missing_ok=True)
        rows = open_rows(path, ["t_s", "u_v", "y_um"], {"stage": "P-885"}, False)
        rows.add([100 * T, U, Y])
        rows.add([100 * T + 3.0, U, Y])
        out.append(bytes([i]) + path.read_bytes())
        rows.close()
    return tuple(out)


def clean_up() -> None:
    """Remove the files of this process."""
    for path in FOLDER.iterdir():
        path.unlink()
    os.rmdir(FOLDER)
