"""Variables of a MATLAB file, read by a process of its own (python -m
dehyst.daemon.files.mat_file).

scipy's reader ends some damaged files with a segmentation fault, which no `except` holds.
"""

import resource
import subprocess
import sys
import tempfile
from pathlib import Path
from typing import Any

import numpy as np

from dehyst.models.errors import BadRecording

PATIENCE_S = 60.0
MOST_BYTES = 3 << 30
"""Of address space: the libraries take 2 GB of it and use little."""


def read_mat(path: Path) -> dict[str, Any]:
    """Variables by name. Raises BadRecording where scipy cannot read the file or dies of it."""
    with tempfile.TemporaryDirectory(prefix="dehyst-mat-") as folder:
        read = Path(folder) / "read.npz"
        command = [sys.executable, "-P", "-m", "dehyst.daemon.files.mat_file", str(path), str(read)]
        try:
            done = subprocess.run(
                command, capture_output=True, text=True, errors="replace", timeout=PATIENCE_S
            )
        except subprocess.TimeoutExpired:
            raise BadRecording(f"{path}: not read within {PATIENCE_S:g} s") from None
        if done.returncode:
            words = done.stderr.strip().splitlines()
            why = words[-1] if words and done.returncode > 0 else "its reader crashed on it"
            raise BadRecording(f"{path}: not a MATLAB file that can be read: {why}")
        with np.load(read, allow_pickle=False) as data:
            return {key: data[key] for key in data.files}


def main(source: str, target: str) -> None:
    """Read one file and write its variables as .npz."""
    from scipy.io import loadmat  # only who reads MATLAB files waits for it

    resource.setrlimit(resource.RLIMIT_AS, (MOST_BYTES, MOST_BYTES))
    try:
        found = loadmat(source, squeeze_me=True)
    except MemoryError:
        sys.exit("it unpacks to more than can be read; cut it into several files")
    arrays: dict[str, Any] = {k: np.asarray(v) for k, v in found.items() if k[:2] != "__"}
    for key, values in arrays.items():
        if values.dtype.hasobject:
            sys.exit(f"{key} does not hold numbers")
    np.savez(target, **arrays)


if __name__ == "__main__":
    main(*sys.argv[1:])
