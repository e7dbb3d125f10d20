"""Emulated bench of a configuration: `dehyst setup --emulated` creates it, and `dehyst run
--config` starts it again. A note in the folder of its ports identifies the bench."""

import json
import shlex
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path

from dehyst.daemon.config import Controller
from dehyst.daemon.files.outputs import whole_file
from dehyst.daemon.service.supervisor import BenchProcess
from dehyst.models.errors import BadInput

NOTE = "emulated.json"


def note_bench(folder: Path, arguments: list[str]) -> None:
    """Store the options of `dehyst emulate` for the bench whose ports are in `folder`."""
    with whole_file(folder / NOTE) as file:  # not files.models.write_text, which imports numba
        file.write(json.dumps({"emulate": arguments}).encode() + b"\n")


def noted(folder: Path) -> list[str]:
    """Return the options of the bench whose ports are in `folder`; empty if there is no note.
    Raises BadInput if it cannot be read."""
    path = folder / NOTE
    if not path.is_file():
        return []
    try:
        return [str(word) for word in json.loads(path.read_text())["emulate"]]
    except (OSError, ValueError, KeyError, TypeError):
        raise BadInput(f"{path}: not the record of an emulated bench; delete it") from None


def command_of(folder: Path, arguments: list[str]) -> str:
    """Return the command that starts the bench alone."""
    return shlex.join(["dehyst", "emulate", *arguments, "--dir", str(folder)])


@contextmanager
def started_for(controller: Controller, say: Callable[[str], None]) -> Iterator[None]:
    """Run the bench of a configuration while it is in use. Do nothing if its ports are hardware, or
    if the bench is already running. Raises BadInput if its note cannot be read."""
    port = controller.axes[0].actuator.settings.get("port")
    folder = Path(str(port)).parent if isinstance(port, str) else Path()
    if not isinstance(port, str) or Path(port).exists() or not (folder / NOTE).is_file():
        yield
        return
    arguments = noted(folder)
    say(f"starting its emulated bench: {command_of(folder, arguments)}")
    bench = BenchProcess(folder, arguments)
    try:
        yield
    finally:
        bench.close()
