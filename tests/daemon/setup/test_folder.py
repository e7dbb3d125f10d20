"""The folder of a set-up: found from every working directory, used by one process at a time, and
untouched where an option is wrong."""

import os
import re
import shlex
from pathlib import Path

import pytest
from tests.rigs.processes import dehyst, emulated_bench

from dehyst.daemon.bench.emulated import command_of
from dehyst.daemon.config import load_config
from dehyst.daemon.main import main
from dehyst.daemon.rings.run_folder import locked

WORDS = ("--yes", "--emulated", "--range", "0", "150", "--until", "configuration")


def set_up_here(folder: str, cwd: Path) -> str:
    """Run the steps that move nothing; return stderr."""
    process = dehyst("setup", folder, *WORDS, cwd=cwd)
    _, err = process.communicate(timeout=100)
    assert process.returncode == 0, err
    return err


def refused(folder: Path, *words: str) -> str:
    """Return the last line of a set-up that is refused."""
    process = dehyst("setup", str(folder), *words)
    _, err = process.communicate(timeout=60)
    assert process.returncode == 2, err
    return err.splitlines()[-1]


@pytest.mark.parametrize(
    ("option", "value"),
    [
        *(("--band", value) for value in ("-1", "0")),
        *(("--duration", value) for value in ("-1", "0")),
        *(("--rate", value) for value in ("-5", "0")),
        *(("--slew", value) for value in ("-1", "0")),
    ],
)
def test_a_number_that_fits_no_units_is_refused_at_once(
    option: str, value: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    folder = tmp_path / "stage"
    assert main(["setup", str(folder), *WORDS, f"{option}={value}"]) == 2
    said = capsys.readouterr().err
    assert said.startswith(f"dehyst setup: {option} {value}: a ")
    assert said.count("\n") == 1
    assert not folder.exists()


@pytest.mark.parametrize("limits", [("5", "5"), ("100", "0")])
def test_an_empty_range_is_refused_at_once(
    limits: tuple[str, str], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    folder = tmp_path / "stage"
    assert main(["setup", str(folder), "--yes", "--emulated", "--range", *limits]) == 2
    assert "give the lowest voltage first" in capsys.readouterr().err
    assert not folder.exists()


def test_a_path_that_no_configuration_can_contain_is_refused_at_once(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    folder = tmp_path / os.fsdecode(b"st\xe4nd")
    assert main(["setup", str(folder), *WORDS]) == 2
    assert "its path is not UTF-8" in capsys.readouterr().err
    assert not folder.exists()


def test_a_folder_is_the_same_from_every_directory(tmp_path: Path) -> None:
    """The configuration has the ports' whole paths, so that it runs from every directory, and the
    set-up resumes however its folder is spelled."""
    (tmp_path / "home").mkdir()
    (tmp_path / "link").symlink_to(tmp_path)
    folder = tmp_path / "Prüf stand"
    said = set_up_here("../Prüf stand", tmp_path / "home")
    config = load_config(folder / "stage.toml")
    for device in (config.actuator, config.sensor):
        assert Path(device.settings["port"]).parent == folder / "bench"
    (again,) = re.findall(r"`(dehyst run [^`]*)`", said)
    assert os.path.samefile(tmp_path / "home" / shlex.split(again)[-1], folder / "stage.toml")
    assert "the controller's name is stage-1, because 'Prüf stand' is not a valid name" in said
    written = (folder / "stage.toml").stat().st_mtime_ns
    for spelled, cwd in ((".", folder), (str(tmp_path / "link" / "Prüf stand"), Path("/"))):
        assert set_up_here(spelled, cwd).count(": done 20") == 3
    assert (folder / "stage.toml").stat().st_mtime_ns == written


def test_two_set_ups_do_not_share_a_folder(tmp_path: Path) -> None:
    with locked(tmp_path, "setup", "setup", tmp_path, ""):
        said = refused(tmp_path, *WORDS)
    assert f"is in use by process {os.getpid()} (dehyst setup of {tmp_path})" in said
    assert not (tmp_path / "bench").exists()


def test_a_bench_that_runs_keeps_its_ports(tmp_path: Path) -> None:
    """Neither a set-up nor another bench takes the ports of one that runs; a bench that was killed
    is replaced."""
    folder = tmp_path / "bench"
    with emulated_bench(folder) as ports:
        before = {name: os.readlink(ports[name]) for name in ("mdt693b", "ksg101")}
        assert "its emulated bench is in use" in refused(tmp_path, *WORDS)
        second = dehyst(*shlex.split(command_of(folder, []))[1:])
        _, err = second.communicate(timeout=60)
        assert second.returncode == 2
        assert "another emulated bench runs there" in err.splitlines()[-1]
        assert {name: os.readlink(ports[name]) for name in before} == before
    killed = dehyst("emulate", "--dir", str(folder))
    assert killed.stdout is not None
    killed.stdout.readline()
    killed.kill()
    killed.communicate()
    assert (folder / "control").exists()
    with emulated_bench(folder) as ports:
        assert Path(ports["mdt693b"]).exists()
