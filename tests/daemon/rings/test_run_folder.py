"""The run folder belongs to its user alone, or the start is refused; files in it follow no
links."""

import os
import re
import subprocess
from pathlib import Path

import numpy as np
import pytest
from tests.rigs.processes import dehyst, simulated_config

from dehyst.daemon.config import parse_config
from dehyst.daemon.rings.ring import Ring
from dehyst.daemon.rings.run_folder import make_run_folder
from dehyst.models.errors import BadInput, NotNow

PAIR = np.dtype([("a", "<i8"), ("b", "<f8")])
NOBODY = 65534

as_root = pytest.mark.skipif(os.geteuid() != 0, reason="needs a second user")


def refused(folder: Path, tmp_path: Path) -> str:
    """Return what `dehyst core` prints for this run folder; it must end with 2 and one line."""
    config = simulated_config(tmp_path, 200.0, Path("paper-eq11"))
    text = re.sub('run_dir = ".*"', f'run_dir = "{folder}"', config.read_text())
    config.write_text(text)
    process = dehyst("core", "--config", str(config))
    _, words = process.communicate(timeout=60)
    assert process.returncode == 2, words
    assert len(words.strip().splitlines()) == 1
    assert str(folder) in words
    return words


def test_it_is_made_for_its_user_alone(tmp_path: Path) -> None:
    make_run_folder(tmp_path / "run")
    assert (tmp_path / "run").stat().st_mode & 0o777 == 0o700
    os.chmod(tmp_path / "run", 0o755)  # readable by others, writable by none: made private
    make_run_folder(tmp_path / "run")
    assert (tmp_path / "run").stat().st_mode & 0o777 == 0o700


def test_one_that_others_may_write_into_is_refused(tmp_path: Path) -> None:
    folder = tmp_path / "run"
    folder.mkdir()
    os.chmod(folder, 0o777)
    assert "others may write into it" in refused(folder, tmp_path)
    assert list(folder.iterdir()) == []


@as_root
def test_one_that_belongs_to_somebody_else_is_refused(tmp_path: Path) -> None:
    folder = tmp_path / "run"
    folder.mkdir(mode=0o700)
    os.chown(folder, NOBODY, NOBODY)
    assert f"belongs to user {NOBODY}" in refused(folder, tmp_path)
    assert list(folder.iterdir()) == []


def test_a_link_in_its_place_is_refused(tmp_path: Path) -> None:
    (tmp_path / "elsewhere").mkdir(mode=0o700)
    (tmp_path / "run").symlink_to(tmp_path / "elsewhere")
    assert "a link" in refused(tmp_path / "run", tmp_path)
    assert list((tmp_path / "elsewhere").iterdir()) == []


def test_a_folder_that_others_could_exchange_is_refused(tmp_path: Path) -> None:
    shared = tmp_path / "shared"
    shared.mkdir()
    os.chmod(shared, 0o777)
    with pytest.raises(BadInput, match="replace"):
        make_run_folder(shared / "run")
    os.chmod(shared, 0o1777)  # as /tmp: only the owner may rename
    make_run_folder(shared / "run")


def test_links_laid_for_the_files_overwrite_nothing(tmp_path: Path) -> None:
    """A link placed under the name of a run file is not followed, so its target is not overwritten;
    every name that a ring uses while it is made is new."""
    victim = tmp_path / "victim"
    victim.write_text("precious")
    folder = tmp_path / "run"
    make_run_folder(folder)
    for name in ("telemetry.ring", f"telemetry.{os.getpid()}.new", "output.lock"):
        (folder / name).symlink_to(victim)
    Ring.create(folder / "telemetry.ring", PAIR, 8)
    assert victim.read_text() == "precious"
    assert not (folder / "telemetry.ring").is_symlink()
    (folder / "telemetry.ring").unlink()
    (folder / "telemetry.ring").symlink_to(victim)
    with pytest.raises(BadInput):
        Ring.attach(folder / "telemetry.ring", PAIR)
    assert "output.lock" in refused(folder, tmp_path)
    assert victim.read_text() == "precious"


def test_without_a_folder_of_the_user_the_name_holds_the_user(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    monkeypatch.delenv("RUNTIME_DIRECTORY", raising=False)
    monkeypatch.delenv("XDG_RUNTIME_DIR", raising=False)
    text = simulated_config(tmp_path, 200.0, Path("none")).read_text()
    config = parse_config(re.sub("run_dir = .*", "", text))
    assert config.directory.name == f"dehyst-{os.geteuid()}-test"


@pytest.mark.processes
def test_no_room_is_said_and_leaves_nothing_behind(tmp_path: Path) -> None:
    """A full disk is reported and leaves no file. Uses a file system of 64 kB; skipped where this
    machine does not let one be mounted."""
    folder = tmp_path / "run"
    folder.mkdir(mode=0o700)
    mount = ["mount", "-t", "tmpfs", "-o", "size=64k", "none", str(folder)]
    if subprocess.run(mount, check=False, capture_output=True).returncode:
        pytest.skip("needs the right to mount a small disk")
    try:
        os.chmod(folder, 0o700)
        with pytest.raises(NotNow, match="make room"):
            Ring.create(folder / "telemetry.ring", PAIR, 65536)
        assert list(folder.iterdir()) == []
        Ring.create(folder / "telemetry.ring", PAIR, 64)
    finally:
        subprocess.run(["umount", "-l", str(folder)], check=True)
