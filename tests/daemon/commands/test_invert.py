"""dehyst invert: files in, files out, exit codes; its preview is the one the daemon uses."""

import json
import re
from pathlib import Path

import numpy as np
import pytest

from dehyst.daemon.files.recordings import read_recording
from dehyst.daemon.main import main
from dehyst.models.hysteresis.forward import simulate_hysteresis
from dehyst.models.inverse.compensator import Compensator
from dehyst.models.inverse.offline import invert_streamed
from dehyst.models.modelfile import shipped
from dehyst.models.units import how_many

DT = 1e-3


def _trajectory(path: Path, values: np.ndarray, unit: str = "um") -> Path:
    lines = [f"{i * DT:.6f},{v:.9g}" for i, v in enumerate(values)]
    path.write_text(f"t_s,target_{unit}\n" + "\n".join(lines) + "\n")
    return path


def _sine() -> np.ndarray:
    return 6.0 - 2.0 * np.cos(2 * np.pi * 5 * np.arange(500) * DT)


def test_whole_trajectory_tracks_on_the_forward_model(tmp_path: Path) -> None:
    source, out = _trajectory(tmp_path / "t.csv", _sine()), tmp_path / "u.csv"
    assert main(["invert", "paper-eq12", str(source), "-o", str(out)]) == 0
    drive = read_recording(out).drive
    y = simulate_hysteresis(shipped("paper-eq12").hysteresis, np.concatenate([[0.0], drive]), DT)[
        1:
    ]
    assert np.sqrt(np.mean((y - _sine())[200:] ** 2)) < 2e-3


def test_preview_is_what_the_daemon_would_do(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    source, out = _trajectory(tmp_path / "t.csv", 1e3 * _sine(), "nm"), tmp_path / "u.csv"
    args = ["invert", "paper-eq12", str(source), "-o", str(out), "--preview", "0.05", "--json"]
    assert main(args) == 0
    said = json.loads(capsys.readouterr().out)
    assert said["mode"] == "preview"
    assert said["latency_s"] == pytest.approx(0.049)
    written = read_recording(out)
    c = Compensator(shipped("paper-eq12"), DT, 0.0, 10.0, 1e12, "auto", 0.05)
    want = invert_streamed(c, np.round(1e3 * _sine(), 5) * 1e-3).drive
    assert np.max(np.abs(written.drive - want)) < 1e-6
    assert written.t_s[10] == pytest.approx(10 * DT)


def test_targets_out_of_reach_give_exit_1(tmp_path: Path) -> None:
    source, out = _trajectory(tmp_path / "t.csv", 4.0 * _sine()), tmp_path / "u.csv"
    assert main(["invert", "paper-eq11", str(source), "-o", str(out)]) == 1
    assert np.any(read_recording(out).channels["flags"] > 0)


@pytest.mark.parametrize(
    ("change", "says"),
    [
        (["--min", "5", "--max", "4"], "--min 5: must be below --max, 4"),
        (["--max", "-1"], "--min 0: must be below --max, -1"),
        (["--period", "-1"], "--period"),
        (["--period", "100"], "--period 100: longer than the trajectory, which takes"),
        (["--slew", "0"], "--slew 0: must be greater than 0"),
        (["--preview", "-1"], "--preview -1: must be from 0 to 60 s"),
    ],
)
def test_bad_arguments_are_one_line(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], change: list[str], says: str
) -> None:
    source = _trajectory(tmp_path / "t.csv", _sine())
    assert main(["invert", "paper-eq12", str(source), "-o", str(tmp_path / "u.csv"), *change]) == 2
    error = capsys.readouterr().err
    assert says in error
    assert len(error.strip().splitlines()) == 1


def test_one_of_something_is_in_the_singular(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    source = tmp_path / "t.csv"
    source.write_text("t_s,target_um\n0,3\n")
    args = ["invert", "paper-eq12", str(source), "-o", str(tmp_path / "u.csv"), "--period", "0.1"]
    assert main(args) == 0
    assert "u.csv: 1 sample, " in capsys.readouterr().out
    assert [how_many(n, "row") for n in (0, 1, 2)] == ["0 rows", "1 row", "2 rows"]
    assert how_many(2, "row is", "rows are") == "2 rows are"


def test_no_count_is_followed_by_a_plural_that_is_always_there() -> None:
    """Where a count may be 1, `how_many` says the noun."""
    always = re.compile(r"\{[\w.]*(?:size|count|rows|samples)\} (?:rows|samples)\b")
    folder = Path(__file__).parents[3] / "daemon"
    for path in (*folder.glob("commands/*.py"), *folder.glob("api/*.py")):
        assert not always.findall(path.read_text()), path


def test_uneven_times_are_refused_or_resampled(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    source = tmp_path / "t.csv"
    source.write_text("t_s,target_um\n0,3\n0.001,3\n0.0025,4\n0.0035,4\n")
    args = ["invert", "paper-eq11", str(source), "-o", str(tmp_path / "u.csv")]
    assert main(args) == 2
    assert "--period" in capsys.readouterr().err
    assert main([*args, "--period", "0.0005"]) == 0
    assert read_recording(tmp_path / "u.csv").size == 8
