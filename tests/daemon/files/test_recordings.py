"""Recordings are read and written bit by bit; damage is reported in one clear line, and gaps are
reported."""

import gzip
import os
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp
from scipy.io import savemat

from dehyst.daemon.files import csv_table
from dehyst.daemon.files.recordings import read_recording, read_trajectory, write_recording
from dehyst.models.errors import BadRecording

GOOD = b"t_s,u_v,y_um\n0,1,2\n0.1,1.5,2.5\n0.2,2,3\n"

DAMAGED = {
    "empty.csv": (b"", "is empty"),
    "notes.csv": (b"# stage: a\n", "no header line"),
    "binary.csv": (bytes(range(256)) * 20, "zero byte"),
    "latin.csv": (b"t_s,u_v\n0,\xe9\n", "no rows of numbers"),
    "headless.csv": (b"0,1,2\n1,2,3\n", "--columns t=0,u=1"),
    "notime.csv": (b"temp_c,u_v\n20,1\n20,3\n", "--rate HZ"),
    "nodrive.csv": (b"t_s,y_um\n0,1\n1,2\n", "no heading names the drive"),
    "twice.csv": (b"t_s,u_v,u_v\n0,1,2\n1,2,3\n", "twice"),
    "ragged.csv": (b"t_s,u_v,y_um\n0,1,2\n1,2\n", "line 3 has 2 fields"),
    "letters.csv": (b"# a: 1\nt_s,u_v,y_um\n0,1,2\n1,abc,2\n", "line 4: u_v is 'abc'"),
    "backwards.csv": (
        b"t_s,u_v,y_um\n0,1,2\n\n# x\n1,1,2\n1,1,7\n9,1,2\n",
        "line 6: the time does not increase",
    ),
    "timegap.csv": (b"t_s,u_v,y_um\n0,1,2\n,1,2\n", "line 3: the time is missing"),
    "short.csv": (b"t_s,u_v,y_um\n0,1,2\n", "1 row of data"),
    "unit.csv": (b"t_s,u_hz,y_um\n0,1,2\n1,2,3\n", "no heading names the drive"),
    "unity.csv": (b"t_s,u_v,y_hz\n0,1,2\n1,2,3\n", "y_hz is not a displacement"),
    "huge.csv": (b"t_s,u_v,y_um\n0,1,1e300\n1,2,3\n", "line 2: y_um is 1e+300"),
    "infinite.csv": (b"t_s,u_v,y_um\n0,1,3\n1,inf,3\n", "line 3: u_v is inf"),
    "semicolons.csv": (
        b"t_s;u_v;y_um\n0;1;2\n0;1;3\n7;1;3\n",
        "line 3: the time does not increase",
    ),
    "fake.csv.gz": (b"hello", "cannot be read"),
    "cut.csv.gz": (gzip.compress(GOOD * 50)[:60], "cannot be read"),
    "fake.npz": (b"hello", "not an .npz file"),
    "fake.mat": (b"hello", "not a MATLAB file"),
    "other.jpg": (b"", "unknown kind of file"),
}


# scipy's reader of .mat files runs in its own process
@pytest.mark.parametrize(
    "name",
    [pytest.param(n, marks=pytest.mark.processes if n.endswith(".mat") else ()) for n in DAMAGED],
)
def test_damaged_file_is_named_in_one_line(tmp_path: Path, name: str) -> None:
    content, says = DAMAGED[name]
    path = tmp_path / name
    path.write_bytes(content)
    with pytest.raises(BadRecording) as error:
        read_recording(path)
    assert says in str(error.value)
    assert name in str(error.value)
    assert "\n" not in str(error.value)


def test_long_line_and_absent_file(tmp_path: Path) -> None:
    path = tmp_path / "long.csv"
    path.write_bytes(b"t_s,u_v\n" + b"1" * (1 << 17))
    with pytest.raises(BadRecording, match="too long"):
        read_recording(path)
    with pytest.raises(BadRecording, match="no such file"):
        read_recording(tmp_path / "absent.csv")
    with pytest.raises(BadRecording, match="directory"):
        read_recording(tmp_path)


def test_missing_values_and_gaps_stay_missing(tmp_path: Path) -> None:
    path = tmp_path / "a.csv"
    path.write_bytes(
        b"\xef\xbb\xbf# stage: P-885\r\nt_s,u_v,y_um,temp_c\r\n"
        b"0,1,,20\r\n0.1,nan,3,20\r\n0.2,1,3,20\r\n0.6,1,3,20\r\n0.7,1,3,21\r\n"
    )
    rec = read_recording(path)
    assert rec.metadata == {"stage": "P-885"}
    assert rec.missing_drive.tolist() == [False, True, False, False, False]
    assert rec.missing_displacement.tolist() == [True, False, False, False, False]
    assert rec.gaps.tolist() == [2]
    assert rec.period_s == pytest.approx(0.1)
    assert "1 gap in time of" in rec.defects()
    assert rec.channels["temp_c"][-1] == 21
    with pytest.raises(ValueError, match="read-only"):
        rec.drive[0] = 5.0


@pytest.mark.parametrize("word", ["9.91E+37", "-9.9e37"])
def test_what_scpi_writes_for_no_value_is_missing(tmp_path: Path, word: str) -> None:
    path = tmp_path / "run.csv"
    path.write_text(f"t_s,u_v,y_um\n0.0,1.0,2.0\n0.1,1.5,{word}\n0.2,2.0,3.0\n")
    found = read_recording(path)
    assert found.displacement is not None
    np.testing.assert_array_equal(found.displacement, [2.0, np.nan, 3.0])


def test_displacement_can_be_demanded(tmp_path: Path) -> None:
    path = tmp_path / "a.csv"
    path.write_bytes(b"t_s,u_v,y_model_um\n0,1,2\n1,2,3\n")
    assert read_recording(path).displacement is None
    with pytest.raises(BadRecording, match="no heading names the displacement"):
        read_recording(path, need_displacement=True)


@settings(max_examples=20)
@given(
    hnp.arrays(float, st.integers(2, 30), elements=st.floats(-1e9, 1e9)),
    st.sampled_from([".csv", ".csv.gz", ".npz"]),
)
def test_written_recording_reads_back_to_the_bit(
    tmp_path_factory: pytest.TempPathFactory, values: np.ndarray, suffix: str
) -> None:
    path = tmp_path_factory.mktemp("r") / f"a{suffix}"
    t = np.cumsum(np.full(values.size, 1 / 3))
    with_gap = values.copy()
    with_gap[0] = np.nan
    write_recording(path, t, {"u_v": values, "y_um": with_gap, "temp_c": values}, {"who": "me"})
    rec = read_recording(path)
    np.testing.assert_array_equal(rec.t_s, t)
    np.testing.assert_array_equal(rec.drive, values)
    np.testing.assert_array_equal(rec.displacement, with_gap)
    np.testing.assert_array_equal(rec.channels["temp_c"], values)
    assert rec.metadata == {"who": "me"}


@pytest.mark.processes
def test_matlab_file(tmp_path: Path) -> None:
    path = tmp_path / "a.mat"
    savemat(path, {"t_s": np.arange(5.0), "u_v": np.arange(5.0)[:, None], "y_um": np.ones(5)})
    rec = read_recording(path)
    assert rec.drive.tolist() == [0, 1, 2, 3, 4]


@pytest.mark.processes
def test_a_matlab_file_that_crashes_its_reader_is_an_error(tmp_path: Path) -> None:
    path = tmp_path / "a.mat"
    savemat(path, {"t_s": np.arange(3.0), "u_v": np.ones(3), "y_um": np.arange(3, dtype="i2")})
    damaged = bytearray(path.read_bytes())
    damaged[336] = 255  # scipy's loadmat ends with a segmentation fault
    path.write_bytes(damaged)
    with pytest.raises(BadRecording, match="not a MATLAB file that can be read"):
        read_recording(path)


def test_blocks_join_without_seam(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    rng = np.random.default_rng(1)
    t, u = np.arange(3000.0), rng.standard_normal(3000)
    write_recording(tmp_path / "a.csv", t, {"u_v": u})
    monkeypatch.setattr(csv_table, "BLOCK_BYTES", 777)
    np.testing.assert_array_equal(read_recording(tmp_path / "a.csv").drive, u)


def test_failed_write_leaves_nothing(tmp_path: Path) -> None:
    with pytest.raises(BadRecording, match="cannot be written"):
        write_recording(tmp_path / "no" / "a.csv", np.arange(3.0), {"u_v": np.zeros(3)})
    with pytest.raises(BadRecording, match="shape"):
        write_recording(tmp_path / "a.csv", np.arange(3.0), {"u_v": np.zeros(2)})
    assert os.listdir(tmp_path) == []


def test_trajectory(tmp_path: Path) -> None:
    path = tmp_path / "a.csv"
    path.write_bytes(b"t_s,target_um\n0,1\n0.5,2\n")
    trajectory = read_trajectory(path)
    assert (trajectory.target.tolist(), trajectory.unit) == ([1.0, 2.0], "um")
    path.write_bytes(b"t_s,target_um\n0,1\n0.5,\n")
    with pytest.raises(BadRecording, match="line 3: target_um is missing"):
        read_trajectory(path)


def test_a_missing_target_behind_a_row_written_twice_is_named_by_its_own_line(
    tmp_path: Path,
) -> None:
    path = tmp_path / "a.csv"
    path.write_text("t_s,target_um\n0,1\n0.1,2\n0.1,2\n0.2,3\n0.3,\n0.4,4\n")
    with pytest.raises(BadRecording, match="line 6: target_um is missing"):
        read_trajectory(path)
