"""The folder of one mismatch: what the gateway lays there for the doctor, what the doctor finds.

    mismatch-DATE.case/   case.json      what the gateway knows (Case); written last
                          good.csv       the last good recording, where there is one
                          flagged.csv    from the flag on
                          later.csv      what came after it; the offer is tested on it; each of the
                                         three with what led to it in front (Case.leads)
                          in-use.toml    the model that the loop ran
                          found/         diagnosis.json, report.html, model.toml: the augmented one
                          offered.toml   the model that is offered
                          examined.json  what the doctor says (Examined)
                          decided.json   what became of its offer (Decided)

All JSON is written whole or not at all, and read strictly: a file of another version, or a damaged
one, is as if it were not there.
"""

import functools
import logging
import shutil
from pathlib import Path
from typing import Literal, TypeVar

import msgspec

from dehyst.daemon.bus.messages import DoctorState, FoundEffect, LongText, Text
from dehyst.daemon.files.models import write_text
from dehyst.daemon.files.sidecar import notes_path
from dehyst.daemon.input_file import NotReadable, read_text
from dehyst.daemon.prepared import resolve_classes
from dehyst.daemon.rings.run_folder import why_not_trusted
from dehyst.drivers import system

log = logging.getLogger(__name__)

SUFFIX = ".case"
CASE, EXAMINED, DECIDED = "case.json", "examined.json", "decided.json"
GOOD, FLAGGED, LATER, IN_USE = "good.csv", "flagged.csv", "later.csv", "in-use.toml"
FOUND, OFFERED, REPORT = "found", "offered.toml", "found/report.html"
LARGEST_BYTES = 1 << 18


class _Kept(msgspec.Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    pass


class Case(_Kept, frozen=True):
    """number: of the offer that may come of it; figure: of the mismatch watch; low, high, slew: the
    drive's limits, in its unit and its unit a second; leads: by file, its first seconds that only
    lead to what it is about."""

    number: int
    name: str
    time_ns: int
    wall_ns: int
    figure: str
    low: float
    high: float
    slew: float
    rate_hz: float
    later_s: float
    leads: dict[str, float] = {}


class OfferTest(_Kept, frozen=True):
    """An offer's test on later telemetry: rms of both models, without their means."""

    in_use: float
    offered: float
    noise: float
    seconds: float
    blocks: tuple[str, ...] = ()


class Examined(_Kept, frozen=True):
    """What the doctor says. tested: None: no model is offered."""

    failed: bool = False
    verdict: str = ""
    says: LongText = ""
    effects: tuple[FoundEffect, ...] = ()
    unit: str = ""
    noise: float = 0.0
    rms_in_use: float = 0.0
    rms_augmented: float = 0.0
    rms_when_good: float = -1.0
    tested: OfferTest | None = None
    experiment: tuple[Text, ...] = ()


class Decided(_Kept, frozen=True):
    """What became of an offer, and when."""

    state: DoctorState
    wall_ns: int
    because: LongText = ""


resolve_classes(Case, Examined, Decided)
Record = TypeVar("Record", Case, Examined, Decided)
Kind = Literal["case.json", "examined.json", "decided.json"]


def put_record(folder: Path, name: str, record: Case | Examined | Decided) -> None:
    """Write one of the three. Raises OSError."""
    write_text(folder / name, msgspec.json.format(msgspec.json.encode(record)).decode())


def get_record(folder: Path, name: str, kind: type[Record]) -> Record | None:
    """Read one of the three; None: it is not there, or is none."""
    try:
        return msgspec.json.decode(read_text(folder / name, LARGEST_BYTES), type=kind)
    except (NotReadable, msgspec.MsgspecError):
        return None


def case_folder(recording: Path) -> Path:
    """The folder that belongs to a kept recording."""
    return recording.with_suffix(SUFFIX)


@functools.cache
def _say_once(directory: Path, reason: str) -> None:
    log.warning("%s: its cases are not read: %s", directory, reason)


def case_folders(directory: Path) -> list[Path]:
    """All whose case is complete, the oldest first; none where others may write: a model that is
    put to work comes from here."""
    try:
        found = sorted(p.parent for p in directory.glob(f"mismatch-*{SUFFIX}/{CASE}"))
    except OSError:
        return []
    if not found:
        return []
    if reason := why_not_trusted(directory):
        _say_once(directory, reason)
        return []
    return [folder for folder in found if folder.lstat().st_uid == system.user_id()]


def drop_case(recording: Path) -> None:
    """A recording makes room, and what was found about it goes with it."""
    recording.unlink(missing_ok=True)
    notes_path(recording).unlink(missing_ok=True)
    shutil.rmtree(case_folder(recording), ignore_errors=True)
