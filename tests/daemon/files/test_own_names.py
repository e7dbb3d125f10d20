"""A file is taken as it is only if its drive, displacement and target have dehyst's own names: any
other heading that names or measures one of them is interpreted, and the result is noted."""

import json
from collections.abc import Sequence
from pathlib import Path

import numpy as np
import pytest

from dehyst.daemon.files.recordings import (
    read_parts,
    read_recording,
    recording_of,
    write_recording,
)
from dehyst.daemon.main import main
from dehyst.models.errors import BadRecording

T = np.arange(30) * 0.01
U = np.round(np.sin(9 * T), 4)
Y = np.round(0.1 * U + 3.0, 4)

FOREIGN = {
    "headings": (("t_s", "Voltage (kV)", "Displacement (nm)"), ("t_s", "u_v", "y_nm"), 1e3, 1.0),
    "millivolts": (("t_s", "u_mv", "y_um"), ("t_s", "u_v", "y_um"), 1e-3, 1.0),
    "millimetres": (("t_s", "u_v", "y_mm"), ("t_s", "u_v", "y_um"), 1.0, 1e3),
    "words": (("t_s", "voltage_v", "sensor_um"), ("t_s", "u_v", "y_um"), 1.0, 1.0),
    "a unit alone": (("t_s", "u_v", "CH2 (um)"), ("t_s", "u_v", "y_um"), 1.0, 1.0),
}
OWN = (
    ("t_s", "u_v", "trim_um"),
    ("t_s", "u_v", "u2_v"),
    ("t_s", "target_um", "u2_v"),
    ("t_s", "target_x_um", "target_y_um"),
    ("t_s", "target_um", "axis_y_um"),
    ("t_s", "u_v", "temp_c"),
)


def save(path: Path, names: Sequence[str], t: np.ndarray = T) -> Path:
    columns = dict(zip(names, (t, U, Y), strict=True))
    if path.suffix == ".npz":
        np.savez(path, **columns)
    elif path.suffix == ".mcap":
        write_recording(path, t, {name: columns[name] for name in names[1:]})
    else:
        rows = [",".join(map(repr, map(float, row))) for row in zip(t, U, Y, strict=True)]
        path.write_text("\n".join([",".join(names), *rows]) + "\n")
    return path


@pytest.mark.parametrize("suffix", [".csv", ".npz", ".mcap"])
@pytest.mark.parametrize("what", FOREIGN)
def test_another_name_is_interpreted_and_noted(what: str, suffix: str, tmp_path: Path) -> None:
    names, kept, of_drive, of_disp = FOREIGN[what]
    path = save(tmp_path / f"a{suffix}", names)
    found = read_recording(path, need_displacement=True)
    assert main(["convert", str(path), str(tmp_path / "out.csv")]) == 0
    whole = read_recording(tmp_path / "out.csv", need_displacement=True)
    for one in (found, whole, recording_of(dict(zip(names, (T, U, Y), strict=True)), "here")):
        assert ("t_s", one.drive_column, one.displacement_column) == kept
        np.testing.assert_allclose(one.drive, of_drive * U, rtol=1e-12)
        assert one.displacement is not None
        np.testing.assert_allclose(one.displacement, of_disp * Y, rtol=1e-12)
    assert json.loads((tmp_path / "out.csv.meta.json").read_text())["read"] == found.read != ""


@pytest.mark.parametrize("suffix", [".csv", ".npz", ".mcap"])
@pytest.mark.parametrize("names", OWN)
def test_further_channels_keep_their_names(
    names: tuple[str, ...], suffix: str, tmp_path: Path
) -> None:
    parts, said = read_parts(save(tmp_path / f"a{suffix}", names))
    assert (tuple(parts[0][0]), said) == (names, "")


@pytest.mark.parametrize("names", [FOREIGN["headings"][0], ("t_s", "CH1", "CH2")])
def test_milliseconds_are_asked_for_whatever_the_names(
    names: tuple[str, ...], tmp_path: Path
) -> None:
    with pytest.raises(BadRecording, match="--time-unit ms"):
        read_parts(save(tmp_path / "a.csv", names, 500.0 * T))


def test_a_trajectory_may_be_slow(tmp_path: Path) -> None:
    write_recording(tmp_path / "a.csv", 500.0 * T, {"target_um": Y})
    assert read_parts(tmp_path / "a.csv")[1] == ""
