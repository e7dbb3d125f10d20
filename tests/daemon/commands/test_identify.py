"""dehyst identify, simulate and excite as a user runs them."""

import json
import re
from pathlib import Path

import numpy as np
import pytest

from dehyst.daemon.files.models import load_model, save_model
from dehyst.daemon.files.recordings import read_recording, write_recording
from dehyst.daemon.main import main
from dehyst.models.errors import BadModel
from dehyst.models.hysteresis.forward import simulate_hysteresis
from dehyst.models.modelfile import shipped


@pytest.fixture
def recording(tmp_path: Path) -> Path:
    t = np.arange(4000) * 1e-3
    u = 5 - 2 * np.cos(2 * np.pi * 10 * t) - 3 * np.cos(2 * np.pi * 5 * t)
    y = simulate_hysteresis(shipped("paper-eq12").hysteresis, u, 1e-3)
    y += 0.045 * np.random.default_rng(0).standard_normal(t.size)
    write_recording(tmp_path / "run.csv", t, {"u_v": u, "y_um": y})
    return tmp_path / "run.csv"


def test_identify_writes_model_and_report(
    recording: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    folder = recording.parent
    output = folder / "stage.toml"
    code = main(
        ["identify", str(recording), "-o", str(output), "--report", str(folder / "r"), "--json"]
    )
    assert code == 0
    said = json.loads(capsys.readouterr().out)
    model = load_model(output)
    assert model.hysteresis.n == said["order"]
    assert said["rms"] == model.fit.rms < 0.05
    assert said["holdout_rms"] < 0.05
    slopes = said["parameters"]["slopes"]
    assert [one["threshold"] for one in slopes] == model.hysteresis.r.tolist()
    bounds = [one[name] for one in slopes for name in ("at_rate_max", "at_minus_rate_max")]
    assert all(b["low"] is None or b["low"] < b["value"] < b["high"] for b in bounds)
    assert any(b["low"] is None for b in bounds)  # a slope on its bound has no interval
    rates = np.array([one["rate"] for one in slopes])
    top = np.cumsum(model.hysteresis.b) + rates * np.cumsum(model.hysteresis.k)
    assert [one["at_rate_max"]["value"] for one in slopes] == pytest.approx(top)
    assert rates[0] < rates[-1] == model.validity.rate_max  # low just after a reversal
    for one in said["parameters"]["saturation"]:
        assert one["low"] < model.hysteresis.c[one["power"]] < one["high"]
    assert model.provenance.recordings == (("run.csv", read_recording(recording).sha256),)
    assert model.provenance.created
    assert model.validity.rate_max == pytest.approx(196, rel=0.02)
    assert model.validity.acceleration_max == pytest.approx(10_860, rel=0.01)  # sum of (2 pi f)^2 a
    assert model.validity.band_hz == pytest.approx(10, rel=0.1)
    page = (folder / "r" / "report.html").read_text("utf-8")
    pictures = re.findall(r'<img alt="([^"]*)" src="data:image/png;base64,', page)
    assert len(pictures) == page.count("<img") == 9
    for shown in ("over a few cycles", "hysteresis loop", "Residual over time", "Residual over the "
                  "drive", "Spectrum", "each drive occurs at each rate", "Loop sizes",
                  "Slope after a reversal"):  # fmt: skip
        assert any(shown in said for said in pictures)
    assert not re.search(r'(src|href)="(?!data:)', page)
    assert "noise" in page
    assert "slope at +" in page


@pytest.mark.parametrize("hum_um", [0.0, 0.2])
def test_an_interval_or_why_there_is_none(
    recording: Path, hum_um: float, capsys: pytest.CaptureFixture[str]
) -> None:
    """A hum of 3 noises, which the model lacks."""
    one = read_recording(recording)
    assert one.displacement is not None
    hummed = one.displacement + hum_um * np.sin(2 * np.pi * 23.7 * one.t_s)
    path = recording.parent / "hummed.csv"
    write_recording(path, one.t_s, {"u_v": one.drive, "y_um": hummed})
    assert main(["identify", str(path), "-o", str(recording.parent / "stage.toml")]) == 0
    out = capsys.readouterr().out
    stated = "95 % prediction interval for other drives in this range: +-" in out
    assert stated == (hum_um == 0.0)
    assert (
        "um rms, is not mostly noise; another waveform may cause half to three" in out
    ) != stated


def test_identify_in_words_and_fixed(recording: Path, capsys: pytest.CaptureFixture[str]) -> None:
    output = recording.parent / "stage.toml"
    arguments = ["--static", "--order", "6", "--saturation", "3", "--no-bias"]
    assert main(["identify", str(recording), "-o", str(output), *arguments]) == 0
    out, err = capsys.readouterr()
    assert "static, odd polynomial of degree 3, 6 operators" in out
    assert "dehyst diagnose" in out
    assert err == ""


@pytest.mark.parametrize(
    ("arguments", "says"),
    [
        (["identify", "absent.csv", "-o", "m.toml"], "no such file"),
        (["identify", "run.csv", "run.csv", "-o", "m.toml"], "the same content as run.csv"),
        (["identify", "semicolons.csv", "-o", "m.toml"], "1 row of data"),
        (["identify", "headless.csv", "-o", "m.toml"], "--columns t=0,u=1,y=2"),
        (["identify", "run.csv", "-o", "m.toml", "--order", "0"], "order"),
        (["simulate", "absent.toml", "run.csv", "-o", "o.csv"], "shipped models"),
        (["excite", "--range", "0", "10"], "--band"),
        (["excite", "--check", "absent.csv"], "no such file"),
    ],
)
def test_bad_usage_is_one_line(
    recording: Path,
    arguments: list[str],
    says: str,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    monkeypatch.chdir(recording.parent)
    Path("semicolons.csv").write_text("t_s;u_v;y_um\n0,0;0,0;0,0\n")
    Path("headless.csv").write_text("0,0,0\n0.1,1,1\n")
    assert main(arguments) == 2
    out, err = capsys.readouterr()
    assert says in err
    assert err.count("\n") == 1
    assert out == ""


def test_simulate_adds_the_model(recording: Path, capsys: pytest.CaptureFixture[str]) -> None:
    output = recording.parent / "out.csv"
    assert main(["simulate", "paper-eq12", str(recording), "-o", str(output)]) == 0
    assert "um rms" in capsys.readouterr().out
    rec = read_recording(output)
    want = simulate_hysteresis(shipped("paper-eq12").hysteresis, rec.drive, 1e-3)
    np.testing.assert_allclose(rec.channels["y_model_um"], want, atol=1e-6)


@pytest.mark.parametrize(
    ("turns", "start"),
    [((), "de-energised"), ((10.0, 0.0), "from above"), ((0.0, 6.0, 2.0, 5.0, 0.0), "")],
)
def test_simulate_says_which_samples_its_error_is_over(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], turns: tuple[float, ...], start: str
) -> None:
    """If the stage was driven before the recording, the start is unknown: the model is prepared by
    a history that fits; if none does, the error is also reported for the rows that no longer depend
    on the start."""
    h = shipped("paper-eq11").hysteresis
    assert 2 * h.r.max() == pytest.approx(9.844)  # after this much travel the start is forgotten
    t = np.arange(3000) * 1e-3
    u = 5 - 5 * np.cos(2 * np.pi * t)  # covers 9.844 V in 0.4601 s
    way = np.interp(np.linspace(0, len(turns), 2000), np.arange(len(turns) + 1), [0.0, *turns])
    y = simulate_hysteresis(h, np.concatenate([way, u]), 1e-3)[2000:]
    y += 0.01 * np.random.default_rng(0).standard_normal(t.size)
    recording, output = tmp_path / "run.csv", tmp_path / "out.csv"
    write_recording(recording, t, {"u_v": u, "y_um": y})
    assert main(["simulate", "paper-eq11", str(recording), "-o", str(output)]) == 0
    words = capsys.readouterr().out
    arguments = ["simulate", "paper-eq11", str(recording), "-o", str(output), "--force", "--json"]
    assert main(arguments) == 0
    said = json.loads(capsys.readouterr().out)
    assert "over all 3000 rows" in words
    assert ("over the 2539 from 0.461 s on" in words) == (not start)
    assert said["settled_from_s"] == pytest.approx(0.461)
    assert said["rms_settled"] == pytest.approx(0.01, rel=0.05)
    if start:
        assert said["start"] == start
        assert said["rms"] == pytest.approx(0.01, rel=0.05)
    else:
        assert said["rms"] > 0.011


def test_simulate_says_so_where_every_row_depends_on_the_start(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    t = np.arange(1000) * 1e-3
    u = 2 - np.cos(2 * np.pi * 5 * t)
    write_recording(tmp_path / "run.csv", t, {"u_v": u, "y_um": u})
    output = tmp_path / "out.csv"
    assert main(["simulate", "paper-eq11", str(tmp_path / "run.csv"), "-o", str(output)]) == 0
    assert "all of them depend on the unknown earlier state" in capsys.readouterr().out


def test_simulate_needs_only_the_inputs_and_fills_nothing_in(tmp_path: Path) -> None:
    t = np.arange(50) * 1e-3
    u = np.linspace(0, 5, 50)
    u[20] = np.nan
    write_recording(tmp_path / "d.csv", t, {"u_v": u})
    output = tmp_path / "o.csv"
    assert main(["simulate", "paper-eq11", str(tmp_path / "d.csv"), "-o", str(output)]) == 0
    y = read_recording(output).channels["y_model_um"]
    assert np.flatnonzero(np.isnan(y)).tolist() == [20]


def test_excite_and_check(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    drive, picture = tmp_path / "d.csv", tmp_path / "p.png"
    design = ["--range", "0", "10", "--band", "10", "--duration", "8"]
    assert main(["excite", *design, "-o", str(drive), "--picture", str(picture), "--json"]) == 0
    said = json.loads(capsys.readouterr().out)
    assert len(said["sines"]) == 3
    assert picture.read_bytes().startswith(b"\x89PNG")
    assert main(["excite", "--check", str(drive)]) == 0
    assert "enough for a static and for a rate-dependent model" in capsys.readouterr().out
    t = np.arange(3000) * 1e-3
    write_recording(drive, t, {"u_v": 5 - 5 * np.cos(2 * np.pi * t)})
    assert main(["excite", "--check", str(drive)]) == 1
    assert "missing" in capsys.readouterr().out


def test_model_files_name_themselves(tmp_path: Path) -> None:
    path = tmp_path / "m.toml"
    save_model(shipped("paper-eq12"), path)
    np.testing.assert_array_equal(load_model(path).hysteresis.b, shipped("paper-eq12").hysteresis.b)
    path.write_text("format = 2")
    with pytest.raises(BadModel, match=r"m\.toml: format"):
        load_model(path)
    path.write_bytes(b"\xff\xfe")
    with pytest.raises(BadModel, match="not UTF-8 text"):
        load_model(path)
    with pytest.raises(BadModel, match="cannot be written"):
        save_model(shipped("paper-eq12"), tmp_path / "no" / "m.toml")
