"""Devices as files laid out like sysfs, and one kernel file whose owner can disappear."""

import subprocess
import sys
from pathlib import Path


def lay_out(folder: Path, files: dict[str, str]) -> Path:
    """Create a device's folder with its files, each ending with a newline."""
    folder.mkdir(exist_ok=True)
    for name, text in files.items():
        (folder / name).write_text(text + "\n")
    return folder


def take_away(folder: Path) -> None:
    """Remove the device: its folder is gone, and open files become empty."""
    gone = folder.with_name(folder.name + ".gone")
    folder.rename(gone)
    for file in gone.glob("*_raw"):
        (gone / (file.name + ".kept")).write_text(file.read_text())
        file.write_text("")


def put_back(folder: Path) -> None:
    """Restore the device as it was."""
    gone = folder.with_name(folder.name + ".gone")
    for kept in gone.glob("*.kept"):
        (gone / kept.name.removesuffix(".kept")).write_text(kept.read_text())
        kept.unlink()
    gone.rename(folder)


class KernelFile:
    """A number that the kernel keeps for a process (oom_score_adj, 0 to 1000 here): read and
    written like an attribute in sysfs, refused above 1000, an error once the process has ended."""

    def __init__(self) -> None:
        self._owner = subprocess.Popen(
            [sys.executable, "-c", "import sys; sys.stdin.read()"], stdin=subprocess.PIPE
        )
        self.path = Path(f"/proc/{self._owner.pid}/oom_score_adj")
        self.path.write_text("0")

    def end(self) -> None:
        """End the owner; safe to call twice."""
        assert self._owner.stdin is not None
        self._owner.stdin.close()
        self._owner.wait()
