"""Folder of one mismatch: what the gateway stores for the doctor, and what the doctor finds.

    mismatch-DATE.case/   case.json      data from the gateway (Case); written last
                          good.csv       the last good recording, if there is one
                          flagged.csv    recorded from the flag on
                          later.csv      recorded afterwards; the offer is tested on it; each of
                                         the three files begins with a lead-in (Case.leads)
                          in-use.toml    the model that the loop ran
                          found/         diagnosis.json, report.html, model.toml: augmented model
                          offered.toml   the model that is offered
                          examined.json  the doctor's result (Examined)
                          decided.json   the decision on its offer (Decided)

All JSON is written completely or not at all, and parsed strictly: a file of another version, or a
damaged one, is treated as missing.
"""

import functools
import logging
import shutil
from pathlib import Path
from typing import Literal, TypeVar

import msgspec

from dehyst.daemon.bus.messages import DoctorState, FoundEffect, LongText, Text
from dehyst.daemon.files.models import write_text
from dehyst.daemon.files.outputs import notes_path
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
    """number: of the offer that may follow; figure: of the mismatch watch; low, high, slew: the
    drive's limits, in its unit and its unit per second; leads: duration of the lead-in of each file
    [s]."""

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
    """Result of an offer's test on later telemetry: rms errors of both models, means removed."""

    in_use: float
    offered: float
    noise: float
    seconds: float
    blocks: tuple[str, ...] = ()


class Examined(_Kept, frozen=True):
    """The doctor's result. tested: None: no model is offered."""

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
    """Decision on an offer, and its time."""

    state: DoctorState
    wall_ns: int
    because: LongText = ""


resolve_classes(Case, Examined, Decided)
Record = TypeVar("Record", Case, Examined, Decided)
Kind = Literal["case.json", "examined.json", "decided.json"]


def put_record(folder: Path, name: str, record: Case | Examined | Decided) -> None:
    """Write one of the three records. Raises OSError."""
    write_text(folder / name, msgspec.json.format(msgspec.json.encode(record)).decode())


def get_record(folder: Path, name: str, kind: type[Record]) -> Record | None:
    """Read one of the three records; None if it is missing or invalid."""
    try:
        return msgspec.json.decode(read_text(folder / name, LARGEST_BYTES), type=kind)
    except (NotReadable, msgspec.MsgspecError):
        return None


def case_folder(recording: Path) -> Path:
    """Return the folder that belongs to a kept recording."""
    return recording.with_suffix(SUFFIX)


@functools.cache
def _say_once(directory: Path, reason: str) -> None:
    log.warning("%s: its cases are not read: %s", directory, reason)


def case_folders(directory: Path) -> list[Path]:
    """Return all complete case folders, oldest first; none if others may write to the directory,
    because a model in use may come from here."""
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
    """Delete a recording together with everything that was found about it."""
    recording.unlink(missing_ok=True)
    notes_path(recording).unlink(missing_ok=True)
    shutil.rmtree(case_folder(recording), ignore_errors=True)
