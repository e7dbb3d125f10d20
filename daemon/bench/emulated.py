"""The emulated bench of a configuration: `dehyst setup --emulated` makes it, `dehyst run --config`
starts it again. A note in the folder of its ports says which bench it is."""

import json
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path

from dehyst.daemon.config import Controller
from dehyst.daemon.files.outputs import whole_file
from dehyst.daemon.service.supervisor import BenchProcess
from dehyst.models.errors import BadInput

NOTE = "emulated.json"


def note_bench(folder: Path, arguments: list[str]) -> None:
    """Write down which bench has its ports in `folder`: the options of `dehyst emulate`."""
    with whole_file(folder / NOTE) as file:  # files.models has write_text, and brings numba
        file.write(json.dumps({"emulate": arguments}).encode() + b"\n")


def noted(folder: Path) -> list[str]:
    """The options of the bench whose ports are in `folder`; none where there is no note. Raises
    BadInput where it cannot be read."""
    path = folder / NOTE
    if not path.is_file():
        return []
    try:
        return [str(word) for word in json.loads(path.read_text())["emulate"]]
    except (OSError, ValueError, KeyError, TypeError):
        raise BadInput(f"{path}: not the note of an emulated bench; delete it") from None


def command_of(folder: Path, arguments: list[str]) -> str:
    """The command that starts it by itself."""
    return " ".join(["dehyst emulate", *arguments, "--dir", str(folder)])


@contextmanager
def started_for(controller: Controller, say: Callable[[str], None]) -> Iterator[None]:
    """The bench of a configuration while it is used; nothing where its ports are hardware, or where
    the bench runs already. Raises BadInput where its note cannot be read."""
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
