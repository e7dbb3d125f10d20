"""Every command that takes a recording accepts those of other programs, and reports once how it
read them."""

import json
from pathlib import Path

import numpy as np
import pytest
from tests.rigs.stage_model import model_text

import dehyst
from dehyst.daemon.files.recordings import read_columns, write_recording
from dehyst.daemon.main import main
from dehyst.daemon.page.jobs import Setting, identify_file, say_refusal
from dehyst.models.errors import BadRecording

N, RATE_HZ = 2000, 500.0
T = np.arange(N) / RATE_HZ
U = 5.0 + 4.0 * np.sin(2 * np.pi * 1.1 * T) * np.cos(2 * np.pi * 0.3 * T)
NOISE = np.random.default_rng(5).normal(0.0, 0.002, N)
HEAD = "Zeit [s];Spannung [V];Weg [µm]\n"


@pytest.fixture(autouse=True)
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.chdir(tmp_path)
    Path("model.toml").write_text(model_text())
    y = dehyst.simulate("model.toml", {"t_s": T, "u_v": U}).displacement + NOISE
    rows = [f"{t:.4f};{u:.5f};{v:.5f}\n" for t, u, v in zip(T, U, y, strict=True)]
    Path("german.csv").write_text(HEAD + "".join(rows).replace(".", ","), encoding="cp1252")
    np.savetxt("plain.txt", np.stack([U, y], axis=1))
    Path("way.csv").write_text(
        "Time (s),Target (um)\n" + "".join(f"{t:.4f},{0.5 + 0.2 * np.sin(t)}\n" for t in T)
    )
    return tmp_path


GERMAN = (
    "german.csv: read 2000 rows: t from 'Zeit [s]', drive from 'Spannung [V]', displacement from "
    "'Weg [µm]'; separated by semicolons; decimal commas"
)


def said(capsys: pytest.CaptureFixture[str], *words: str, code: int = 0) -> str:
    assert main(list(words)) in {code, 0, 1} - ({0, 1} if code == 2 else set())
    return capsys.readouterr().err


@pytest.mark.parametrize(
    "words",
    [
        "identify german.csv -o found.toml --static --order 6",
        "diagnose german.csv -o found",
        "validate model.toml german.csv",
        "simulate model.toml german.csv -o out.csv",
        "excite --check german.csv",
        "convert german.csv out.csv",
    ],
)
def test_each_command_says_once_how_a_file_was_understood(
    words: str, capsys: pytest.CaptureFixture[str]
) -> None:
    err = said(capsys, *words.split())
    assert err.splitlines().count(GERMAN) == 1
    assert err.count("read 2000 rows") == 1


def test_convert_writes_down_what_was_understood(capsys: pytest.CaptureFixture[str]) -> None:
    said(capsys, "convert", "german.csv", "out.csv")
    columns, notes = read_columns("out.csv")
    assert list(columns) == ["t_s", "u_v", "y_um"]
    np.testing.assert_allclose(columns["u_v"], U, atol=1e-5)
    assert json.loads(Path("out.csv.meta.json").read_text())["read"] == GERMAN == notes["read"]
    assert said(capsys, "convert", "out.csv", "again.npz") == ""


def test_identify_takes_its_rate_and_that_of_the_rows(capsys: pytest.CaptureFixture[str]) -> None:
    """`--rate` alone requests a rate-dependent model; with a number it is the rows per second."""
    words = ["identify", "plain.txt", "-o", "m.toml", "--static", "--order", "4"]
    err = said(capsys, *words, code=2)
    assert "--columns u=0,y=1 --rate HZ" in err
    given = ["--columns", "u=0,y=1", "--rate", "500", "--unit", "um"]
    err = said(capsys, *words, *given)
    assert "t from --rate (0.002 s a row)" in err
    found = dehyst.load_recording("plain.txt", columns={"u": 0, "y": 1}, rate_hz=500.0, unit="um")
    np.testing.assert_allclose(found.t_s, T)


def test_a_trajectory_of_another_program(capsys: pytest.CaptureFixture[str]) -> None:
    err = said(capsys, "invert", "model.toml", "way.csv", "-o", "drive.csv")
    assert err.count("way.csv: read 2000 rows: t from 'Time (s)', target from 'Target (um)'") == 1


def test_a_clock_that_went_back_is_written_as_two_files(
    capsys: pytest.CaptureFixture[str],
) -> None:
    lines = Path("german.csv").read_text(encoding="cp1252").splitlines(True)
    Path("twice.csv").write_text("".join([*lines, *lines[1:900]]), encoding="cp1252")
    err = said(capsys, "convert", "twice.csv", "out.csv")
    assert "the clock went back at line 2002: cut there into 2 parts" in err
    sizes = [read_columns(f"out-part{i}.csv")[0]["t_s"].size for i in (1, 2)]
    assert sizes == [2000, 899]
    err = said(capsys, "simulate", "model.toml", "twice.csv", "-o", "o.csv", code=2)
    assert "dehyst convert twice.csv" in err


def test_the_page_says_it_too(tmp_path: Path) -> None:
    settings: dict[str, Setting] = {}
    result = identify_file(tmp_path, tmp_path / "german.csv", settings, lambda *_: None)
    assert result["said"].startswith(GERMAN)
    refusal = say_refusal(BadRecording("a.txt: add --columns u=0"))
    assert refusal.endswith("dehyst convert with these options writes a file that needs none")


@pytest.mark.parametrize(
    "words",
    [
        "identify gaps.csv -o found.toml --static --order 6",
        "validate model.toml gaps.csv",
        "simulate model.toml gaps.csv -o out.csv",
        "convert gaps.csv out.csv",
        "excite --check gaps.csv",
    ],
)
def test_each_command_says_once_what_is_missing(
    words: str, capsys: pytest.CaptureFixture[str]
) -> None:
    y = 0.1 * U + NOISE
    y[300:350] = np.nan
    u = np.where(np.arange(N) % 400 == 7, np.nan, U)
    write_recording("gaps.csv", np.where(T < 2.0, T, T + 3.0), {"u_v": u, "y_um": y})
    assert main(words.split()) in (0, 1)
    printed = capsys.readouterr()
    said = "gaps.csv: 5 drive values missing, 50 displacement values missing, 1 gap in time"
    assert (printed.out + printed.err).count(said) == 1


@pytest.mark.parametrize(
    "words",
    [
        "simulate model.toml slow.csv -o out.csv",
        "identify slow.csv --static --order 5 -o slow.toml",
        "validate model.toml slow.csv",
        "convert slow.csv out.csv",
    ],
)
def test_times_that_may_be_milliseconds_are_remarked_once(
    words: str, capsys: pytest.CaptureFixture[str]
) -> None:
    write_recording("slow.csv", 250.0 * T, {"u_v": U, "y_um": 0.1 * U + NOISE})
    err = said(capsys, *words.split())
    assert err.count("the rows lie 0.5 s apart") == 1


@pytest.mark.parametrize(
    ("head", "missing"),
    [
        ("Time (s),Untitled,Untitled 1", "no drive and no displacement"),
        ("Time (s),Voltage (V),Untitled", "no displacement"),
        ("Time (s),Voltage (V),Position (um)", ""),
        ("Time (s),Target (um),Untitled", ""),  # a trajectory needs neither
    ],
)
def test_a_converted_file_that_no_command_can_use_is_noted(
    capsys: pytest.CaptureFixture[str], head: str, missing: str
) -> None:
    rows = [f"{t:.4f},{u:.4f},{0.1 * u:.5f}" for t, u in zip(T, U, strict=True)]
    Path("export.csv").write_text("\n".join([head, *rows, ""]))
    shown = said(capsys, "convert", "export.csv", "out.csv")
    noted = [line for line in shown.splitlines() if line.startswith("note: out.csv has")]
    assert len(noted) == bool(missing)
    for line in noted:
        assert f"has {missing}, which identify" in line
        assert "if that is right" in shown.partition("add --columns ")[2]  # and the names
