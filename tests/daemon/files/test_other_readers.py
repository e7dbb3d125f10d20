"""pandas and numpy read every CSV that dehyst writes, unchanged and with one call."""

import json
from array import array
from pathlib import Path

import numpy as np
import pytest
from tests.daemon.files.test_recorder import telemetry, write

from dehyst.daemon.files.recordings import read_columns, write_recording
from dehyst.daemon.main import main
from dehyst.drivers.emulated.bench import BenchLog


def model_and_inputs(folder: Path) -> tuple[str, str]:
    """Write a drive and a trajectory for the paper's model; return their paths."""
    t_s = 0.001 * np.arange(400)
    write_recording(folder / "in.csv", t_s, {"u_v": 5 + 4 * np.sin(9 * t_s)}, {"a": "b, c"})
    write_recording(folder / "way.csv", t_s, {"target_um": 5 + 2 * np.sin(9 * t_s)}, {"a": "b"})
    return str(folder / "in.csv"), str(folder / "way.csv")


def writers(folder: Path) -> dict[str, Path]:
    """Write one CSV of each kind that a command writes; return the paths by name."""
    drive, way = model_and_inputs(folder)
    write(folder / "record.csv", telemetry(500))
    write(folder / "record.csv.gz", telemetry(500))
    missing = {"y_um": np.array([1.0, np.nan, 3.0]), "flag": np.array([True, False, True])}
    write_recording(folder / "gap.csv", np.arange(3.0), missing, {"stage": "a", "b": "#1"})
    commands = {
        "simulate.csv": ["simulate", "paper-eq12", drive],
        "invert.csv": ["invert", "paper-eq12", way],
        "convert.csv": ["convert", str(folder / "record.csv.gz")],
        "excite.csv": ["excite", "--range", "0", "75", "--band", "10", "--duration", "5"],
    }
    for name, words in commands.items():
        output = str(folder / name)
        last = [output] if words[0] == "convert" else ["-o", output]
        assert main([*words, *last]) == 0, name
    log = BenchLog()
    log.of("x").output_ns, log.of("x").output_v = array("q", [1, 2]), array("d", [0.5, 1e-9])
    log.save(folder / "emulate.csv")
    return {path.name: path for path in folder.iterdir() if path.name.endswith((".csv", ".csv.gz"))}


def test_pandas_and_numpy_read_every_csv(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    pandas = pytest.importorskip("pandas")  # would cost every worker half a second
    files = writers(tmp_path)
    capsys.readouterr()
    assert len(files) == 10
    for name, path in files.items():
        frame = pandas.read_csv(path)
        table = np.genfromtxt(path, delimiter=",", names=True)
        assert list(frame.columns) == list(table.dtype.names), name
        assert all(kind.kind in "fiu" for kind in frame.dtypes), name
        if name == "emulate.csv":
            assert frame["volts"].tolist() == [0.5, 1e-9]
            continue
        columns, _ = read_columns(path)
        assert list(frame.columns) == list(columns), name
        for key, values in columns.items():
            assert np.array_equal(frame[key], values, equal_nan=True), (name, key)
            assert np.array_equal(table[key], values, equal_nan=True), (name, key)


def test_what_belongs_beside_the_numbers_is_beside_the_file(tmp_path: Path) -> None:
    drive, _ = model_and_inputs(tmp_path)
    assert Path(drive).read_text().startswith("t_s,u_v\n")
    assert json.loads((tmp_path / "in.csv.meta.json").read_text()) == {"a": "b, c"}
