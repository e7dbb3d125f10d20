"""Records failed starts of the gateway, for the status of the next one that starts.

While the gateway cannot get its address, no client can query it. The supervisor or systemd, which
restarts it, logs this in its own way; each attempt leaves a note in the run folder, and the next
gateway that starts reports in its status how long and why clients could not reach the daemon.
"""

from pathlib import Path

import msgspec

from dehyst.daemon import clock
from dehyst.daemon.bus.messages import Text
from dehyst.daemon.files.models import write_text
from dehyst.daemon.prepared import resolve_classes

FILE = "gateway.refused"
LONGEST_BYTES = 4096  # the text in such a note has at most 500 characters


class RefusedStarts(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """Failed starts in a row. starts: their number; since_ns: monotonic time of the first [ns];
    because: error message of the last one."""

    starts: int = 0
    since_ns: int = 0
    because: Text = ""


resolve_classes(RefusedStarts)


def read_refused_starts(folder: Path) -> RefusedStarts:
    """Read the note in a run folder; return an empty one if there is none or it is unreadable."""
    try:
        with (folder / FILE).open("rb") as file:
            return msgspec.json.decode(file.read(LONGEST_BYTES), type=RefusedStarts)
    except (OSError, msgspec.MsgspecError):
        return RefusedStarts()


def add(folder: Path, because: str) -> None:
    """Note one more failed start. If the file cannot be written, only the note is lost."""
    before, now_ns = read_refused_starts(folder), clock.monotonic_ns()
    since_ns = before.since_ns if 0 < before.since_ns <= now_ns else now_ns
    note = RefusedStarts(before.starts + 1, since_ns, because[:500])
    try:
        write_text(folder / FILE, msgspec.json.encode(note).decode())
    except OSError:
        return


def take_refusals(folder: Path) -> RefusedStarts:
    """Return the note and delete it, as the gateway has started."""
    note = read_refused_starts(folder)
    try:
        (folder / FILE).unlink(missing_ok=True)
    except OSError:
        return note
    return note
