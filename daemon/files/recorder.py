"""Write telemetry to a recording as it arrives: .csv, .csv.gz, .npz or .mcap, in one file or in
pieces.

Columns: `t_s` (the sample's deadline, counted from the first one), the drive in the model's unit,
the measured displacement, the target, what trim and learning added to it, whether the deadline was
missed, the flags (dehyst.daemon.rings.records.Flag). A reading is taken before the voltage of its
sample is written, so its row holds the voltage written one sample earlier: the drive in force.
Displacements count from the set-point origin, or from the model's own zero with frame "model".
Missing readings and targets are empty; missing samples are missing rows. Displacement (from the
same kind of zero) and drive in force of the controller's other axes are further columns.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from types import TracebackType
from typing import Any, Self

import numpy as np
from numpy.typing import NDArray

from dehyst.daemon.files.appended import RecordingFailed
from dehyst.daemon.files.axis_columns import axis_column
from dehyst.daemon.files.pieces import Pieces, Rotation
from dehyst.daemon.files.rows import Columns, RowWriter, check_kind, open_rows
from dehyst.daemon.rings.records import Flag
from dehyst.models.units import how_many

NO_OTHERS: Mapping[str, NDArray[Any]] = {}


@dataclass(frozen=True)
class OtherAxis:
    """Another axis of the controller: its name, actuator volts per drive unit, and units; origin:
    added to its displacements."""

    name: str
    gain: float
    drive_unit: str
    unit: str
    origin: float = 0.0


class Recorder:
    """Appends TELEMETRY records to a recording; use with `with`. The file is created with the first
    record.

    path: the file, which must not exist unless `replace`; gain: actuator volts per drive unit;
    units: (drive, displacement); origin: added to displacements; metadata: notes, to which
    `started` is added; rotation: write numbered pieces instead; others: axes whose samples are
    passed with each `add`. Raises BadInput on a kind that cannot be written.
    """

    def __init__(
        self,
        path: Path,
        gain: float,
        units: tuple[str, str],
        origin: float,
        metadata: dict[str, str],
        replace: bool = False,
        rotation: Rotation | None = None,
        others: Sequence[OtherAxis] = (),
    ) -> None:
        check_kind(path)
        self.path, self._gain, self._origin = path, gain, origin
        self.gaps = 0
        self.time_s = float("nan")  # of the newest row
        self.pieces = Pieces(path, rotation)
        self._first_ns: int | None = None
        # newest sample, whose voltage is the next row's drive; below, those of the other axes
        self._before: Any = None
        self._others = others
        self._others_before: dict[str, Any] = {}
        self._notes, self._replace = dict(metadata), replace
        drive, disp = units
        self._names = (
            "t_s",
            f"u_{drive}",
            *(f"{what}_{disp}" for what in ("y", "target", "trim", "learned")),
            "missed",
            "flags",
            *(axis_column(other.name, other.unit) for other in others),
            *(axis_column(other.name, other.drive_unit, drive=True) for other in others),
        )
        self._complete_rows = 0
        self._piece: RowWriter | None = None
        self._piece_from_s = 0.0

    @property
    def rows(self) -> int:
        """Samples written so far."""
        return self._complete_rows + (self._piece.rows if self._piece is not None else 0)

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        if self._first_ns is None and error is None:  # no sample arrived: write only the header
            self._begin_piece(0.0)
        self._end_piece()

    def add(
        self,
        samples: NDArray[Any],
        until_s: float = float("inf"),
        wall_offset_ns: int = 0,
        others: Mapping[str, NDArray[Any]] = NO_OTHERS,
    ) -> bool:
        """Append (n,) TELEMETRY records, ascending, up to but excluding the time until_s; return
        True once that time is reached. wall_offset_ns: wall clock minus the records' clock, 0 if
        not known; others: (n,) records of the other axes at the same times. Raises BadInput if the
        file cannot be created, RecordingFailed if the disk is full or gone; the file then ends with
        a complete row."""
        if not samples.size:
            return False
        if self._first_ns is None:
            self._first_ns = int(samples["scheduled_ns"][0])
            if wall_offset_ns:
                start_us = (self._first_ns + wall_offset_ns) // 1000
                self._notes["started"] = f"{np.datetime64(start_us, 'us')}+00:00"
        t_s = (samples["scheduled_ns"] - self._first_ns) / 1e9
        if (self.rows and t_s[0] <= self.time_s) or np.any(np.diff(t_s) <= 0):
            raise RecordingFailed(
                f"{self.path}: the daemon's clock restarted (a reboot?); the recording ends "
                f"after {how_many(self.rows, 'sample')}"
            )
        keep = t_s < until_s
        done = not keep.all()
        samples, t_s = samples[keep], t_s[keep]
        if samples.size:
            beside = [others[other.name][keep] for other in self._others]
            self._append(
                (
                    t_s,
                    self._drive(samples, self._before, self._gain),
                    samples["measured"] + self._origin,
                    samples["target"] + self._origin,
                    samples["trim"],
                    samples["learned"],
                    np.asarray((samples["flags"] & int(Flag.MISSED)) != 0, np.uint8),
                    samples["flags"],
                    *(
                        of["measured"] + other.origin
                        for other, of in zip(self._others, beside, strict=True)
                    ),
                    *(
                        self._drive(of, self._others_before.get(other.name), other.gain)
                        for other, of in zip(self._others, beside, strict=True)
                    ),
                )
            )
            self._count_gaps(samples)
            for other, of in zip(self._others, beside, strict=True):
                self._others_before[other.name] = of[-1].copy()
            self.time_s = float(t_s[-1])
            self._before = samples[-1].copy()
        return done

    def _append(self, columns: Columns) -> None:
        """Write to the current piece, and to the next ones after each rotation time."""
        t_s, rotation = columns[0], self.pieces.rotation
        while True:
            if self._piece is None:
                self._begin_piece(float(t_s[0]))
            assert self._piece is not None
            if rotation is None:
                self._piece.add(columns)
                return
            cut = int(np.searchsorted(t_s, self._piece_from_s + rotation.every_s))
            if cut:
                self._piece.add([column[:cut] for column in columns])
                self.pieces.hold_to_bound(self._piece.size)
            columns = [column[cut:] for column in columns]
            t_s = columns[0]
            if t_s.size or self._piece.full or rotation.due(0.0, self._piece.size):
                self._end_piece()
            if not t_s.size:
                return

    def _begin_piece(self, from_s: float) -> None:
        notes = dict(self._notes)
        if self.pieces.rotation is not None:
            notes["piece_from_s"] = repr(from_s)
        self._piece = open_rows(self.pieces.next(), self._names, notes, self._replace)
        self._piece_from_s = from_s
        self.pieces.hold_to_bound(self._piece.size)

    def _end_piece(self) -> None:
        if self._piece is not None:
            piece, self._piece = self._piece, None
            try:
                piece.close()
            finally:
                self._complete_rows += piece.rows

    def _count_gaps(self, samples: NDArray[Any]) -> None:
        self.gaps += int(np.count_nonzero(np.diff(samples["seq"]) != 1))
        if self._before is not None:
            self.gaps += int(self._before["seq"]) + 1 != int(samples["seq"][0])

    @staticmethod
    def _drive(samples: NDArray[Any], before: Any, gain: float) -> NDArray[np.float64]:
        """Return the drive in force at each reading: the voltage of the previous sample, NaN after
        a gap. before: the record preceding these."""
        out = np.full(samples.size, np.nan)
        out[1:] = samples["volts"][:-1]
        out[1:][np.diff(samples["seq"]) != 1] = np.nan
        if before is not None and int(before["seq"]) + 1 == int(samples["seq"][0]):
            out[0] = before["volts"]
        return np.asarray(out / gain)
