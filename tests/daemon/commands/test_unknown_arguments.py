"""An argument that a command does not know is answered with a pointer to that command's help."""

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


@pytest.mark.parametrize("rate", ["1000", "0.5", "1e3", "2.5E2"])
def test_a_rate_of_samples_is_told_from_a_rate_dependent_model(rate: str) -> None:
    assert _in_hertz("identify", ["--rate", rate, "a.csv"]) == ["--rate-hz", rate, "a.csv"]
    assert _in_hertz("identify", ["--rate", "a.csv"]) == ["--rate", "a.csv"]
