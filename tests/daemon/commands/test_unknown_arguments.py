"""An argument that a command does not know is answered with a pointer to that command's help."""

from pathlib import Path

import pytest

from dehyst.daemon.main import _in_hertz, main


@pytest.mark.parametrize(
    ("words", "help_of"),
    [
        (["status", "--nothing"], "dehyst status"),
        (["scan", "raster", "--nothing", "-o", "path.csv"], "dehyst scan"),
        (["config", "init", "file.toml"], "dehyst config"),
        (["--nothing", "status"], "dehyst"),
    ],
)
def test_it_is_that_of_the_command(
    words: list[str], help_of: str, capsys: pytest.CaptureFixture[str]
) -> None:
    with pytest.raises(SystemExit, match="2"):
        main(words)
    said = capsys.readouterr().err
    assert said.startswith(f"{help_of}: unrecognized arguments: ")
    assert said.endswith(f"; see `{help_of} --help`\n")


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (["setup", ""], "dehyst setup: an argument is empty: the first one"),
        (["setup", "--yes", ""], "dehyst setup: an argument is empty: '' after --yes"),
        (["identify", "a.csv", "-o", ""], "dehyst identify: an argument is empty: '' after -o"),
        (["identify", "a.csv", "--output="], "dehyst identify: an argument is empty: --output="),
        (["probe", "/dev/null", "-o", ""], "dehyst probe: an argument is empty: '' after -o"),
        (["convert", "", "b.csv"], "dehyst convert: an argument is empty: the first one"),
        (["emulate", "--log", ""], "dehyst emulate: an argument is empty: '' after --log"),
    ],
)
def test_an_empty_argument_is_not_the_working_directory(
    words: list[str],
    said: str,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    monkeypatch.chdir(tmp_path)
    with pytest.raises(SystemExit, match="2"):
        main(words)
    assert capsys.readouterr().err.startswith(f"{said}; give a name or a value there; see")
    assert not list(tmp_path.iterdir())


def test_a_setting_may_be_empty(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["config", "init", "--range", "0", "100", "--set=port="]) == 2
    assert "an argument is empty" not in capsys.readouterr().err


@pytest.mark.parametrize("rate", ["1000", "0.5", "1e3", "2.5E2"])
def test_a_rate_of_samples_is_told_from_a_rate_dependent_model(rate: str) -> None:
    assert _in_hertz("identify", ["--rate", rate, "a.csv"]) == ["--rate-hz", rate, "a.csv"]
    assert _in_hertz("identify", ["--rate", "a.csv"]) == ["--rate", "a.csv"]
