"""The columns of other axes, in files and as channels; pandas and numpy read them unchanged."""

from pathlib import Path

import numpy as np

from dehyst.daemon.api.functions import simulate
from dehyst.daemon.files.recordings import read_recording, read_trajectory
from dehyst.models.model import Block, Hysteresis, Model, Validity
from dehyst.models.recording import Recording

HEADER = "t_s,u_v,y_um,axis_y_um,axis_z_nm,axis_y_drive_v,axis_z_counts,u2_v"
ROWS = "0,1,2,3,4000,5,6,7\n0.1,2,3,4,5000,6,7,8\n0.2,3,4,5,6000,7,8,9\n"


def test_other_axes_are_channels(tmp_path: Path) -> None:
    import pandas  # would cost every worker half a second

    path = tmp_path / "rec.csv"
    path.write_text(f"{HEADER}\n{ROWS}")
    channels = read_recording(path).channels
    assert list(channels) == ["axis.y", "axis.z", "axis.y.drive", "axis_z_counts", "u2_v"]
    np.testing.assert_allclose(channels["axis.y"], [3.0, 4.0, 5.0])
    np.testing.assert_allclose(channels["axis.z"], [4.0, 5.0, 6.0])
    table = np.genfromtxt(path, delimiter=",", names=True)
    assert list(table.dtype.names) == list(pandas.read_csv(path).columns) == HEADER.split(",")


def test_what_is_written_is_read_again(tmp_path: Path) -> None:
    path, out = tmp_path / "rec.csv", tmp_path / "out.csv"
    path.write_text(f"{HEADER}\n{ROWS}")
    line = Hysteresis(r=np.zeros(1), b=np.ones(1), k=np.zeros(1), c=np.array([0.0, 1.0]))
    block = Block("coupling", "stage", {"gain_um_per_unit": 0.5, "reference": 3.0}, "axis.y")
    model = Model(line, Validity(0.0, 10.0), blocks=(block,))
    simulated = simulate(model, path)
    simulated.save(out)
    names = out.read_text().splitlines()[0].split(",")
    assert names[3:6] == ["axis_y_um", "axis_z_um", "axis_y_drive_v"]
    assert names[6:] == ["axis_z_counts", "u2_v", "y_model_um"]
    np.testing.assert_allclose(read_recording(out).channels["axis.z"], [4.0, 5.0, 6.0])
    np.testing.assert_allclose(np.diff(np.asarray(simulated)), [1.5, 1.5])


def test_targets_of_other_axes_are_their_displacements(tmp_path: Path) -> None:
    path = tmp_path / "path.csv"
    path.write_text("t_s,target_x_um,target_y_nm\n0,1,2000\n0.1,2,3000\n")
    trajectory = read_trajectory(path, column="target_x_um")
    np.testing.assert_allclose(trajectory.target, [1.0, 2.0])
    np.testing.assert_allclose(trajectory.channels["axis.y"], [2.0, 3.0])


def test_a_channel_of_another_length_is_converted_without_a_displacement() -> None:
    """`simulate` needs no displacement; a model in nm reads an axis in um all the same."""
    block = Block("coupling", "stage", {"gain_nm_per_unit": 0.5, "reference": 0.0}, "axis.y")
    line = Hysteresis(r=np.zeros(1), b=np.ones(1), k=np.zeros(1), c=np.array([0.0, 1.0]))
    model = Model(line, Validity(0.0, 10.0), "v", "nm", blocks=(block,))
    t_s, axis_um = np.arange(50) * 0.01, np.linspace(0.0, 2.0, 50)
    alone = Recording(t_s, np.zeros(50), channels={"axis.y": axis_um})
    moved = np.asarray(simulate(model, alone))
    np.testing.assert_allclose(moved - moved[0], 0.5 * 1e3 * (axis_um - axis_um[0]), rtol=1e-9)
