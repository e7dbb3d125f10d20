"""dehyst validate as a user runs it."""

import json
import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from dehyst.daemon.files.models import save_model
from dehyst.daemon.files.recordings import read_columns, write_recording
from dehyst.daemon.main import main
from dehyst.models.hysteresis.forward import simulate_hysteresis
from dehyst.models.model import Fit
from dehyst.models.modelfile import shipped

T = 1e-3


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Write a model whose stated error of 45 nm is right, one with wrong weights, and a recording
    of the first one's stage with 45 nm of noise."""
    monkeypatch.chdir(tmp_path)
    model = shipped("paper-eq12")
    save_model(replace(model, fit=Fit(0.045, 0.045, 0.045)), "good.toml")
    h = replace(model.hysteresis, b=1.2 * model.hysteresis.b)
    save_model(replace(model, hysteresis=h, fit=Fit(0.045, 0.045, 0.045)), "bad.toml")
    t = np.arange(6000) * T
    u = 3.5 - 3.5 * np.cos(2 * np.pi * 3 * t)
    y = simulate_hysteresis(model.hysteresis, u, T) + 0.045 * np.random.default_rng(
        1
    ).standard_normal(t.size)
    write_recording(tmp_path / "run.csv", t, {"u_v": u, "y_um": y + 7.0})
    return tmp_path


def test_as_good_as_it_claims(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["validate", "good.toml", "run.csv", "--report", "r", "--json"]) == 0
    (said,) = json.loads(capsys.readouterr().out)
    assert said["rms"] == pytest.approx(0.045, rel=0.05)
    assert said["offset"] == pytest.approx(7.0, abs=0.01)  # the sensor was zeroed elsewhere
    assert said["white"]
    assert said["correlation_with_drive"] < 3 * said["by_chance"]
    assert said["noise_rms"] == pytest.approx(0.045, rel=0.1)
    page = Path("r/validation.html").read_text("utf-8")
    assert page.count("<img") == 3


def test_worse_than_it_claims_is_a_finding(
    folder: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["validate", "good.toml", "bad.toml", "run.csv"]) == 1
    good, bad = capsys.readouterr().out.strip().splitlines()[:2]
    assert "as good as it claims" in good
    assert "WORSE than it claims" in bad
    assert "not white" in bad


def test_a_model_without_an_interval_is_called_so(
    folder: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    model = shipped("paper-eq12")
    save_model(replace(model, fit=Fit(0.045, 0.045, 0.045, band=0.05)), "banded.toml")
    assert main(["validate", "good.toml", "banded.toml", "run.csv"]) == 0
    without, banded = (x for x in capsys.readouterr().out.splitlines() if " on run.csv" in x)
    assert "; the model states no 95 % band;" in without
    assert "of the rows within its 95 % band and the noise" in banded
    assert "states no" not in banded


def test_rows_that_repeat_a_reading_are_counted(
    folder: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    columns, _ = read_columns("run.csv")
    t_s, u, y = (columns[key] for key in ("t_s", "u_v", "y_um"))
    again = np.random.default_rng(3).random(t_s.size) < 0.3
    again[0] = False
    last = np.maximum.accumulate(np.where(again, 0, np.arange(t_s.size)))
    write_recording(folder / "repeating.csv", t_s, {"u_v": u, "y_um": y[last]})
    assert main(["validate", "good.toml", "run.csv", "repeating.csv", "--json"]) == 0
    once, repeating = json.loads(capsys.readouterr().out)
    assert (once["repeated_rows"], repeating["repeated_rows"]) == (0, again.sum())
    assert repeating["rms"] == pytest.approx(once["rms"], rel=0.05)
    assert main(["validate", "good.toml", "repeating.csv"]) == 0
    assert (
        f"{again.sum()} rows repeat the previous reading and are not judged: the gauge"
        in capsys.readouterr().out
    )


def test_a_recording_may_begin_anywhere(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """The rms error does not depend on where the recording begins: here the first loop is already
    over."""
    t = np.arange(6000) * T
    u = 3.5 - 3.5 * np.cos(2 * np.pi * 3 * t)
    y = simulate_hysteresis(shipped("paper-eq12").hysteresis, u, T)
    y += 0.045 * np.random.default_rng(2).standard_normal(t.size)
    write_recording(folder / "late.csv", t[:-500], {"u_v": u[500:], "y_um": y[500:]})
    assert main(["validate", "good.toml", "late.csv", "--json"]) == 0
    assert json.loads(capsys.readouterr().out)[0]["rms"] == pytest.approx(0.045, rel=0.05)


@pytest.mark.parametrize(
    ("arguments", "says"),
    [
        (["validate", "good.toml"], "one model"),
        (["validate", "run.csv"], "one model"),
        (["validate", "good.toml", "absent.csv"], "no such file"),
        (["validate", "good.toml", "other.csv"], "identified from recordings in mrad is needed"),
    ],
)
def test_bad_usage_is_one_line(
    folder: Path, arguments: list[str], says: str, capsys: pytest.CaptureFixture[str]
) -> None:
    t = np.arange(200) * T
    write_recording(folder / "other.csv", t, {"u_v": np.sin(t), "y_mrad": np.sin(t)})
    assert main(arguments) == 2
    out, err = capsys.readouterr()
    assert says in err
    assert err.count("\n") == 1
    assert out == ""


def test_a_constant_reading_has_no_share_and_the_json_is_json(
    folder: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    def refuse(word: str) -> None:
        raise AssertionError(f"{word} is not JSON")

    t = np.arange(600) * T
    u = 3.5 - 3.5 * np.cos(2 * np.pi * 3 * t)
    write_recording(folder / "constant.csv", t, {"u_v": u, "y_um": np.full(t.size, 2.0)})
    words = ["validate", "good.toml", "constant.csv"]
    assert main([*words, "--json"]) == 1
    (constant,) = json.loads(capsys.readouterr().out, parse_constant=refuse)
    assert constant["share_of_span"] is None
    assert main([*words, "--report", "r"]) == 1
    said = capsys.readouterr().out
    assert "no share of the span (the reading is constant)" in said
    assert "nan" not in said


def test_nanometres_are_read_as_the_model_needs_them(
    folder: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    columns, _ = read_columns("run.csv")
    t_s, u, y = (columns[key] for key in ("t_s", "u_v", "y_um"))
    write_recording("nm.csv", t_s, {"u_v": u, "y_nm": 1e3 * y, "axis_y_nm": 1e3 * y})
    assert main(["validate", "good.toml", "run.csv", "nm.csv", "--json"]) == 0
    um, nm = json.loads(capsys.readouterr().out)
    assert nm["rms"] == pytest.approx(um["rms"])
    assert nm["offset"] == pytest.approx(um["offset"])
    assert main(["validate", "good.toml", "nm.csv"]) == 0
    assert "good.toml on nm.csv (nm, as um): " in capsys.readouterr().out
    assert main(["simulate", "good.toml", "nm.csv", "-o", "out.csv"]) == 0
    out, _ = read_columns("out.csv")
    np.testing.assert_allclose(out["y_um"], y)
    np.testing.assert_allclose(out["axis_y_um"], y)
    np.testing.assert_allclose(out["y_model_um"], y - 7.0, atol=0.3)


def test_it_says_how_the_noise_of_the_gauge_is_counted(
    folder: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """The figure in the note is what the judgement subtracts."""
    t = np.arange(6000) * T
    u = 3.5 - 3.5 * np.cos(2 * np.pi * 3 * t)
    y = simulate_hysteresis(shipped("paper-eq12").hysteresis, u, T)
    y += 0.3 * np.random.default_rng(3).standard_normal(t.size)
    write_recording(folder / "noisy.csv", t, {"u_v": u, "y_um": y})
    assert main(["validate", "good.toml", "noisy.csv", "run.csv", "--report", "r"]) == 0
    noisy, quiet = capsys.readouterr().out.split("good.toml on run.csv")
    assert "as good as it claims" in noisy
    (figure,) = re.findall(r"noisier than .*: (\S+) um rms of its noise are not counted", noisy)
    assert float(figure) == pytest.approx(0.3, rel=0.2)
    assert "noisier" not in quiet
    assert "first subtracted from that of the error" in Path("r/validation.html").read_text("utf-8")
