"""Every command that reads or writes a recording supports every kind of file, with the same
result."""

from pathlib import Path

import numpy as np
import pytest

from dehyst.daemon.files.recordings import read_columns, write_recording
from dehyst.daemon.main import main

T = 0.001 * np.arange(600)
MODEL = "paper-eq12"


def made(folder: Path, kind: str) -> dict[str, dict[str, np.ndarray]]:
    """Run each command on files of this kind; return the columns of what it writes."""
    drive, way = folder / f"drive.{kind}", folder / f"way.{kind}"
    write_recording(drive, T, {"u_v": 5 + 4 * np.sin(20 * T), "y_um": np.cos(20 * T)})
    write_recording(way, T, {"target_um": 5 + 2 * np.sin(9 * T)})
    words = {
        "simulate": ["simulate", MODEL, str(drive)],
        "invert": ["invert", MODEL, str(way)],
        "excite": ["excite", "--range", "0", "75", "--band", "10", "--duration", "5"],
    }
    found = {}
    for name, line in words.items():
        path = folder / f"{name}.{kind}"
        assert main([*line, "-o", str(path)]) == 0, (name, kind)
        found[name] = read_columns(path)[0]
    assert main(["excite", "--check", str(drive)]) in (0, 1)
    assert main(["validate", MODEL, str(drive)]) in (0, 1)
    return found


@pytest.fixture(scope="module")
def as_csv(tmp_path_factory: pytest.TempPathFactory) -> dict[str, dict[str, np.ndarray]]:
    return made(tmp_path_factory.mktemp("csv"), "csv")


@pytest.mark.parametrize("kind", ["csv.gz", "npz", "mcap"])
def test_same_result_in_every_kind(
    tmp_path: Path, as_csv: dict[str, dict[str, np.ndarray]], kind: str
) -> None:
    for name, columns in made(tmp_path, kind).items():
        assert list(columns) == list(as_csv[name])
        for key, values in columns.items():
            assert np.array_equal(values, as_csv[name][key], equal_nan=True), (name, key)
