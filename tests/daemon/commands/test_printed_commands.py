"""A command that is printed can be typed as it is, also where a path contains blanks and umlauts;
and it is printed whatever the screen's encoding is."""

import re
import shlex
from pathlib import Path

import numpy as np
import pytest
from tests.rigs.processes import dehyst, simulated_config
from tests.rigs.stage_model import model_text

from dehyst.daemon.bench.emulated import command_of
from dehyst.daemon.files.recordings import read_recording, write_recording
from dehyst.daemon.main import main
from dehyst.daemon.setup.axes_steps import say_what_next
from dehyst.daemon.setup.journal import Journal
from dehyst.daemon.setup.questions import UserPrompts, Wishes
from dehyst.daemon.setup.steps import validate_on
from dehyst.daemon.setup.workbench import Workbench
from dehyst.models.errors import BadRecording


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Make a folder with such a name, with a recording and a model of it."""
    made = tmp_path / "Prüf stand"
    made.mkdir()
    time_s = np.arange(2000) / 1000.0
    drive = 30.0 - 30.0 * np.cos(2 * np.pi * time_s)
    noise = np.random.default_rng(1).normal(0.0, 0.01, time_s.size)
    write_recording(made / "a run.csv", time_s, {"u_v": drive, "y_um": 0.1 * drive + noise})
    (made / "its model.toml").write_text(model_text())
    monkeypatch.chdir(tmp_path)
    return made


def words_of(said: str, beginning: str) -> list[str]:
    """Return the words of the printed line that begins so, as a shell takes them."""
    (line,) = re.findall(rf"({beginning}.*)$", said, re.MULTILINE)
    return shlex.split(line, comments=True)


def test_the_next_command_after_identify(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    out = folder / "a model.toml"
    line = ["identify", str(folder / "a run.csv"), "-o", str(out), "--static", "--order", "3"]
    assert main([*line, "--report", str(folder)]) == 0
    assert words_of(capsys.readouterr().out, "dehyst validate ")[2:] == [str(out), "REC.csv"]
    assert (
        "dehyst validate &#x27;a model.toml&#x27; REC.csv" in (folder / "report.html").read_text()
    )


def test_the_commands_after_a_set_up(folder: Path) -> None:
    said: list[str] = []
    asking = UserPrompts(True, None)  # type: ignore[arg-type]
    bench = Workbench(folder, Wishes(), Journal(folder), asking, said.append)
    models = [folder / "stage-x.model.toml", folder / "stage-y.model.toml"]
    say_what_next(bench, models)
    text, config = "\n".join(said), str(folder / "stage.toml")
    assert words_of(text, "dehyst run ")[-1] == config
    install = words_of(text, "install -D ")
    assert install[4:-2] == [config, *map(str, models)]
    found = validate_on(folder / "its model.toml", {"recording": "a run.csv"}, folder / "v.html")
    words = words_of(found["words"], "dehyst diagnose ")
    assert words[2:] == [
        *(str(folder / "a run.csv"), "--model", str(folder / "its model.toml")),
        *("-o", str(folder / "findings")),
    ]


def test_the_command_of_a_bench(folder: Path) -> None:
    said = command_of(folder / "bench", ["--axes", "2"])
    assert shlex.split(said) == ["dehyst", "emulate", "--axes", "2", "--dir", f"{folder}/bench"]


def test_the_commands_for_a_damaged_recording(folder: Path) -> None:
    cut, twice = folder / "cut short.csv", folder / "two runs.csv"
    cut.write_text("t_s,u_v,y_um\n0.0,1.0,2.0\n0.1,1.0,2.0\n0.2,1.")
    once = "".join(f"{i / 10:g},{i},{2 * i}\n" for i in range(50))
    twice.write_text("t_s,u_v,y_um\n" + 2 * once)
    for path, option in ((cut, ["--unfinished"]), (twice, [])):
        with pytest.raises(BadRecording) as error:
            read_recording(path)
        assert words_of(str(error.value), "dehyst convert ")[2:][: len(option) + 1] == [
            *option,
            path.name,
        ]


@pytest.mark.parametrize("encoding", ["ascii", "latin-1", "utf-8"])
def test_a_screen_of_any_encoding_shows_what_it_can(
    folder: Path, encoding: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A name that the screen cannot show is shown escaped, on stdout and on stderr."""
    config = simulated_config(folder, 200.0, folder / "its model.toml")
    run = folder.rename(folder.with_name("Prüf ständ →"))
    config = run / config.name
    config.write_text(config.read_text().replace(str(folder), str(run)))
    monkeypatch.setenv("PYTHONIOENCODING", encoding)
    for words, status in (
        (["run", "--check", str(config)], 0),
        (["convert", str(run / "a run.csv"), str(run / "→.csv")], 0),
        (["identify", str(run / "none→.csv"), "-o", "m.toml"], 2),
    ):
        process = dehyst(*words, encoding="latin-1")
        out, err = process.communicate(timeout=60)
        assert process.returncode == status, err
        assert "Traceback" not in out + err
        if encoding != "utf-8":
            assert "\\u2192" in out + err
