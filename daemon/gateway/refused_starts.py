"""Starts of the gateway that came to nothing, for the status of the one that can begin.

While the gateway cannot have its address nobody can ask it anything. Who starts it again (the
supervisor, systemd) says so in its own words; each try leaves a note in the run folder, and the
gateway that can begin tells in its status how long clients could not reach the daemon, and why.
"""

from pathlib import Path

import msgspec

from dehyst.daemon import clock
from dehyst.daemon.bus.messages import Text
from dehyst.daemon.files.models import write_text
from dehyst.daemon.prepared import resolve_classes

FILE = "gateway.refused"
LONGEST_BYTES = 4096


class RefusedStarts(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """starts: tries in a row that came to nothing; since_ns: monotonic time of the first [ns];
    because: what the last one said."""

    starts: int = 0
    since_ns: int = 0
    because: Text = ""


resolve_classes(RefusedStarts)


def read_refused_starts(folder: Path) -> RefusedStarts:
    """The note in a run folder; none where there is none, or none that can be read."""
    try:
        with (folder / FILE).open("rb") as file:
            return msgspec.json.decode(file.read(LONGEST_BYTES), type=RefusedStarts)
    except (OSError, msgspec.MsgspecError):
        return RefusedStarts()


def add(folder: Path, because: str) -> None:
    """One more try that came to nothing. A folder that takes no file costs the note alone."""
    before, now_ns = read_refused_starts(folder), clock.monotonic_ns()
    since_ns = before.since_ns if 0 < before.since_ns <= now_ns else now_ns
    note = RefusedStarts(before.starts + 1, since_ns, because[:500])
    try:
        write_text(folder / FILE, msgspec.json.encode(note).decode())
    except OSError:
        return


def take_refusals(folder: Path) -> RefusedStarts:
    """The note, and it is taken away: the gateway has begun."""
    note = read_refused_starts(folder)
    try:
        (folder / FILE).unlink(missing_ok=True)
    except OSError:
        return note
    return note
