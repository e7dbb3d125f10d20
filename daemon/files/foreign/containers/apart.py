"""Read files that need a library in a separate process.

A damaged file can end some of these readers in a segmentation fault, an endless loop or the use of
all memory, which no `except` catches. A separate process also keeps their warnings off the screen.
"""

import json
import subprocess
import sys
import tempfile
import warnings
from pathlib import Path

import numpy as np

from dehyst.daemon.files.foreign.found import Column, Sheet, text_of
from dehyst.drivers import system
from dehyst.models.errors import BadRecording

PATIENCE_S = 120.0
START_S, S_PER_MB = 10, 60
"""Processor time allowed per file [s, s/MB]: the slowest library, openpyxl, took 3 to 6 s for 1 MB,
and small computers are ten times slower. A damaged file of 10 KB kept HDF5 busy for two minutes."""
ENDED_BY_TIME = -24
"""Exit status of a process that used up its processor time: SIGXCPU, which not every system has."""
MOST_BYTES = 4 << 30
"""Limit on address space: the libraries reserve 2 GB and use little of it."""
NEEDS = {
    ".mat": ("a MATLAB file", "scipy", ""),
    ".h5": ("an HDF5 file", "h5py", "hdf5"),
    ".hdf5": ("an HDF5 file", "h5py", "hdf5"),
    ".hdf": ("an HDF5 file", "h5py", "hdf5"),
    ".nc": ("a netCDF file", "h5py", "hdf5"),
    ".xlsx": ("a spreadsheet", "openpyxl", "xlsx"),
    ".xlsm": ("a spreadsheet", "openpyxl", "xlsx"),
    ".tdms": ("a TDMS file", "nptdms", "tdms"),
    ".parquet": ("a Parquet file", "pyarrow", "parquet"),
    ".feather": ("a Feather file", "pyarrow", "parquet"),
    ".json": ("a JSON file", "json", ""),
    ".jsonl": ("a file of JSON lines", "json", ""),
}
"""(description, library that reads it, extra of dehyst that installs it) by suffix."""


DAMAGED = "it is cut short or damaged"
"""All that a library's exception is certain to mean; its own text would mean nothing to a user."""


def read_apart(path: Path) -> Sheet:
    """Return the columns of a file of one of these kinds. Raises BadRecording if the library is not
    installed, cannot read the file, or crashes on it."""
    what, _, _ = NEEDS[path.suffix.lower()]
    with tempfile.TemporaryDirectory(prefix="dehyst-read-") as folder:
        target = Path(folder) / "read.npz"
        try:
            done = start_reader(path, target)
        except subprocess.TimeoutExpired:
            raise BadRecording(f"{path}: not read within {PATIENCE_S:g} s") from None
        if done.returncode == ENDED_BY_TIME:
            raise BadRecording(
                f"{path}: not read within {processor_time_s(path)} s of processor time"
            )
        if done.returncode == 3:
            raise BadRecording(f"{path}: {done.stdout.strip()}")
        if done.returncode == 4:  # in words of the system, or none
            why = done.stdout.strip()[:200] or DAMAGED
            raise BadRecording(f"{path}: not {what} that can be read: {why}")
        if done.returncode:
            raise BadRecording(f"{path}: not {what} that can be read: {DAMAGED}")
        with np.load(target, allow_pickle=False) as data:
            head = json.loads(str(data["head"]))
            columns = [
                Column(values=data[f"c{i}"], **{**one, "wave": one["wave"] and tuple(one["wave"])})
                for i, one in enumerate(head["columns"])
            ]
    return Sheet(columns, **{key: value for key, value in head.items() if key != "columns"})


def processor_time_s(path: Path) -> int:
    """Return the processor time allowed for a file of this size, in whole seconds."""
    return START_S + S_PER_MB * path.stat().st_size // (1 << 20)


def start_reader(path: Path, target: Path) -> subprocess.CompletedProcess[str]:
    """Start a process that reads one file into `target`, and wait for it."""
    command = [sys.executable, "-P", "-m", __name__, str(path), str(target)]
    return subprocess.run(
        command, capture_output=True, encoding="utf-8", errors="replace", timeout=PATIENCE_S
    )


def main(source: str, target: str) -> None:
    """Read one file and write the columns found."""
    from importlib import import_module

    sys.stdout.reconfigure(encoding="utf-8", errors="backslashreplace")  # type: ignore[union-attr]
    path = Path(source)
    _, library, extra = NEEDS[path.suffix.lower()]
    try:
        import_module(library)
        readers = import_module("dehyst.daemon.files.foreign.containers.libraries")
        system.bound_memory(MOST_BYTES)
        system.bound_processor_time(processor_time_s(path))
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            found = readers.READERS[path.suffix.lower()](path)
    except ModuleNotFoundError as error:
        print(
            f"needs the package {error.name}, which is not installed: "
            f"pip install 'dehyst[{extra or 'hdf5'}]'"
        )
        sys.exit(3)
    except BadRecording as error:
        print(str(error))
        sys.exit(3)
    except MemoryError:
        print("it unpacks to more than can be read; cut it into several files")
        sys.exit(3)
    except Exception as error:  # a damaged file raises different exceptions in the libraries
        print((error.strerror or "") if isinstance(error, OSError) and error.errno else "")
        sys.exit(4)
    columns = [
        {
            "heading": text_of(c.heading),
            "unit": text_of(c.unit),
            "clock": c.clock,
            "number": c.number,
            "wave": c.wave,
        }
        for c in found.columns
    ]
    head = {
        "columns": columns,
        "notes": {text_of(key): text_of(text) for key, text in found.notes.items()},
        "step_s": found.step_s,
        "of_some": found.of_some,
        "start_s": found.start_s,
        "factor": text_of(found.factor),
        "stacked": text_of(found.stacked),
        "said": [text_of(text) for text in found.said],
        "blank": {text_of(heading): text_of(text) for heading, text in found.blank.items()},
    }
    arrays = {f"c{i}": c.values for i, c in enumerate(found.columns)}
    np.savez(target, head=np.array(json.dumps(head)), **arrays)


if __name__ == "__main__":
    main(*sys.argv[1:])
