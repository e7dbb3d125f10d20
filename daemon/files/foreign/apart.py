"""Files that a library reads, by a process of its own.

A damaged file ends some of these readers with a segmentation fault, an endless loop or all memory,
which no `except` holds; and their warnings stay off the screen.
"""

import json
import subprocess
import sys
import tempfile
import warnings
from pathlib import Path

import numpy as np

from dehyst.daemon.files.foreign.found import Column, Sheet
from dehyst.drivers import system
from dehyst.models.errors import BadRecording

PATIENCE_S = 120.0
MOST_BYTES = 4 << 30
"""Of address space: the libraries take 2 GB of it and use little."""
NEEDS = {
    ".mat": ("a MATLAB file", "scipy", ""),
    ".h5": ("an HDF5 file", "h5py", "hdf5"),
    ".hdf5": ("an HDF5 file", "h5py", "hdf5"),
    ".xlsx": ("a spreadsheet", "openpyxl", "xlsx"),
    ".tdms": ("a TDMS file", "nptdms", "tdms"),
    ".parquet": ("a Parquet file", "pyarrow", "parquet"),
}
"""What it is, the library that reads it, the extra of dehyst that brings it."""


def read_apart(path: Path) -> Sheet:
    """Columns of a file of one of these kinds. Raises BadRecording: the library is not there, or
    cannot read the file, or dies of it."""
    what, _, _ = NEEDS[path.suffix.lower()]
    with tempfile.TemporaryDirectory(prefix="dehyst-read-") as folder:
        target = Path(folder) / "read.npz"
        command = [sys.executable, "-P", "-m", __name__, str(path), str(target)]
        try:
            done = subprocess.run(
                command, capture_output=True, text=True, errors="replace", timeout=PATIENCE_S
            )
        except subprocess.TimeoutExpired:
            raise BadRecording(f"{path}: not read within {PATIENCE_S:g} s") from None
        if done.returncode == 3:
            raise BadRecording(f"{path}: {done.stdout.strip()}")
        if done.returncode:
            words = done.stderr.strip().splitlines()
            why = words[-1][:200] if words and done.returncode > 0 else "its reader crashed on it"
            raise BadRecording(f"{path}: not {what} that can be read: {why}")
        with np.load(target, allow_pickle=False) as data:
            head = json.loads(str(data["head"]))
            columns = [
                Column(one["heading"], data[f"c{i}"], one["unit"], one["clock"])
                for i, one in enumerate(head["columns"])
            ]
    return Sheet(columns, head["notes"], head["step_s"], head["start_s"], head["said"])


def main(source: str, target: str) -> None:
    """Read one file and write what was found."""
    from importlib import import_module

    path = Path(source)
    _, library, extra = NEEDS[path.suffix.lower()]
    try:
        import_module(library)
        readers = import_module("dehyst.daemon.files.foreign.libraries")
        system.bound_memory(MOST_BYTES)
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
    columns = [{"heading": c.heading, "unit": c.unit, "clock": c.clock} for c in found.columns]
    head = {
        "columns": columns,
        "notes": found.notes,
        "step_s": found.step_s,
        "start_s": found.start_s,
        "said": found.said,
    }
    arrays = {f"c{i}": c.values for i, c in enumerate(found.columns)}
    np.savez(target, head=np.array(json.dumps(head)), **arrays)


if __name__ == "__main__":
    main(*sys.argv[1:])
