"""Tab completion, as the shell itself offers it."""

import shutil
import subprocess
from pathlib import Path

import pytest

from dehyst.daemon.main import main


def completed(script: Path, line: str) -> list[str]:
    """Return what bash offers at the end of the line."""
    program = (
        f"source {script}; COMP_WORDS=({line}); COMP_CWORD=$(({len(line.split())} - 1)); "
        "offer=$(complete -p dehyst | sed 's/.*-F \\([^ ]*\\).*/\\1/'); $offer; "
        "printf '%s\\n' \"${COMPREPLY[@]}\""
    )
    done = subprocess.run(
        ["bash", "-c", program],
        capture_output=True,
        text=True,
        timeout=60,
        check=True,
        cwd=script.parent,
    )
    assert done.stderr == ""
    return done.stdout.split()


@pytest.fixture(scope="module")
def bash_script(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("completion") / "dehyst.bash"
    with pytest.MonkeyPatch.context() as patch, path.open("w") as file:
        patch.setattr("sys.stdout", file)
        assert main(["completion", "bash"]) == 0
    (path.parent / "recording.csv").touch()
    return path


@pytest.mark.skipif(shutil.which("bash") is None, reason="no bash")
@pytest.mark.parametrize(
    ("line", "offers"),
    [
        ("dehyst id", "identify"),
        ("dehyst identify --sa", "--saturation"),
        ("dehyst setup --fr", "--from"),
        ("dehyst setup --from rec", "record"),
        ("dehyst identify rec", "recording.csv"),
        ("dehyst completion z", "zsh"),
    ],
)
def test_bash_offers(bash_script: Path, line: str, offers: str) -> None:
    assert offers in completed(bash_script, line)


@pytest.mark.parametrize("shell", ["zsh", "fish", "tcsh"])
def test_there_is_a_script_for_other_shells(shell: str, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["completion", shell]) == 0
    said = capsys.readouterr().out
    assert "identify" in said
    assert "take-over" in said
