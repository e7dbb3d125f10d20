"""Recordings over weeks: consecutive numbered pieces, of which the oldest are deleted.

NAME.csv becomes NAME-00001.csv, NAME-00002.csv, ...; numbering continues after the existing pieces,
so nothing is replaced. `t_s` continues from piece to piece, and no sample is lost between two
pieces.
"""

import math
import re
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path

from dehyst.daemon.files.outputs import notes_path, report_failures
from dehyst.models.errors import BadInput

SECONDS = {"s": 1.0, "min": 60.0, "h": 3600.0, "d": 86400.0}
BYTES = {"kB": 1e3, "MB": 1e6, "GB": 1e9, "TB": 1e12}
RESERVE_BYTES, RESERVE_SHARE = 1 << 20, 0.03
"""Reserve for a growing piece: a block that is not yet written, and the index of an .mcap."""
LEAST_KEPT = 8 << 20


@dataclass(frozen=True)
class Rotation:
    """When the next piece begins, and how many bytes all pieces together may take on disk; inf: no
    limit. earlier: pieces of earlier recordings of this name may be deleted too."""

    every_s: float = math.inf
    every_bytes: float = math.inf
    keep_bytes: float = math.inf
    earlier: bool = False

    def due(self, seconds: float, size: int) -> bool:
        """Return whether a piece of this duration [s] and size [bytes] is complete."""
        most = min(self.every_bytes, self.keep_bytes / 2 - RESERVE_BYTES)
        return seconds >= self.every_s or size >= most


def parse_rotation(every: str, keep: str | None, earlier: bool) -> Rotation:
    """Parse `--rotate 1h` or `--rotate 500MB`, and `--keep 20GB`. Raises BadInput."""
    amount, unit = _amount("--rotate", every, SECONDS | BYTES)
    keep_bytes = math.inf
    if keep is not None:
        bound, kept_in = _amount("--keep", keep, BYTES)
        keep_bytes = bound * BYTES[kept_in]
        if keep_bytes < LEAST_KEPT:
            raise BadInput(f"--keep {keep}: at least {math.ceil(LEAST_KEPT / 1e6)} MB")
    if unit in SECONDS:
        return Rotation(every_s=amount * SECONDS[unit], keep_bytes=keep_bytes, earlier=earlier)
    every_bytes = amount * BYTES[unit]
    if every_bytes > keep_bytes / 2 - RESERVE_BYTES:
        raise BadInput(f"--rotate {every}: must be below half of --keep {keep}, by 1 MB at least")
    return Rotation(every_bytes=every_bytes, keep_bytes=keep_bytes, earlier=earlier)


def _amount(option: str, text: str, units: dict[str, float]) -> tuple[float, str]:
    found = re.fullmatch(r"(\d+(?:\.\d+)?)\s*([A-Za-z]+)", text)
    if found is None or found[2] not in units or not float(found[1]) > 0:
        raise BadInput(f"{option} {text}: write a number and one of {', '.join(units)}")
    return float(found[1]), found[2]


class Pieces:
    """Files of one recording. path: NAME with its suffix; without rotation, one file of that name.

    made: existing pieces, oldest first; dropped: how many were deleted.
    """

    def __init__(self, path: Path, rotation: Rotation | None) -> None:
        self.rotation = rotation
        self.dropped = 0
        self._path = path
        ends = path.suffixes[-2:] if path.suffix == ".gz" else path.suffixes[-1:]
        self._suffix = "".join(ends)
        self._stem = path.name[: len(path.name) - len(self._suffix)]
        found = self._found() if rotation else {}
        self._number = max(found, default=0)
        earlier = rotation is not None and rotation.earlier
        self.made = [found[number] for number in sorted(found)] if earlier else []
        self._sizes = [_size(path) for path in self.made]  # of the complete pieces

    def _found(self) -> dict[int, Path]:
        """Return the pieces of this name in the folder, by number."""
        shape = re.compile(re.escape(self._stem) + r"-(\d{5,})" + re.escape(self._suffix))
        with report_failures(self._path):
            names = [path.name for path in self._path.parent.iterdir()]
        matches = [found for name in names if (found := shape.fullmatch(name))]
        return {int(found[1]): self._path.with_name(found[0]) for found in matches}

    def next(self) -> Path:
        """Return the path of the next piece, and count it as made."""
        path = self._path
        if len(self._sizes) < len(self.made):
            self._sizes.append(_size(self.made[-1]))
        if self.rotation:
            self._number += 1
            path = self._path.with_name(f"{self._stem}-{self._number:05d}{self._suffix}")
        self.made.append(path)
        return path

    def hold_to_bound(self, growing: int) -> None:
        """Delete the oldest pieces until all pieces together are within the limit. growing: size of
        the newest piece [bytes], to which a reserve is added; the newest is never deleted."""
        if self.rotation is None:
            return
        total = sum(self._sizes) + RESERVE_BYTES + (1 + RESERVE_SHARE) * growing
        while self._sizes and total > self.rotation.keep_bytes:
            path = self.made.pop(0)
            path.unlink(missing_ok=True)
            notes_path(path).unlink(missing_ok=True)
            total -= self._sizes.pop(0)
            self.dropped += 1


def _size(path: Path) -> int:
    """Return the size of a piece and its notes [bytes]."""
    size = 0
    for one in (path, notes_path(path)):
        with suppress(OSError):
            size += one.stat().st_size
    return size
