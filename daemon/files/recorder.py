"""Telemetry into a CSV recording, line by line as it comes, readable at every moment.

Row by row: `t_s` (the sample's deadline, from the first one), the drive in the model's unit, the
measured displacement, the target, what trim and learning added to it, the flags
(dehyst.daemon.rings.records.Flag). A reading is taken before its sample's voltage is written, so
the drive beside it is the one written a sample before: the drive that was in force. Displacements
count from the set-point origin, or from the model's own zero with frame "model". Missing readings
and targets are empty fields; missing samples are missing rows.
"""

import os
from pathlib import Path
from types import TracebackType
from typing import Any, Self

import numpy as np
from numpy.typing import NDArray

from dehyst.models.errors import BadInput, DehystError


class RecordingFailed(DehystError):
    """The file could not be written further; what was written before is whole."""


class Recorder:
    """Appends TELEMETRY records to a CSV file; use with `with`.

    path: the file, a new one unless `replace`; gain: actuator volts per drive unit; units:
    (drive, displacement); origin: added to displacements; metadata: lines at the head.
    Raises BadInput where the file cannot be made.
    """

    def __init__(
        self,
        path: Path,
        gain: float,
        units: tuple[str, str],
        origin: float,
        metadata: dict[str, str],
        replace: bool = False,
    ) -> None:
        if path.suffix != ".csv":
            raise BadInput(f"{path}: recordings are written as .csv")
        self.path, self._gain, self._origin = path, gain, origin
        self.rows = 0
        self.gaps = 0
        self.time_s = float("nan")  # of the newest row
        self._first_ns: int | None = None
        self._before: Any = None  # the newest sample: its voltage is the next row's drive
        drive, disp = units
        header = f"t_s,u_{drive},y_{disp},target_{disp},trim_{disp},learned_{disp},flags\n"
        notes = "".join(f"# {k}: {' '.join(v.split())}\n" for k, v in metadata.items())
        try:
            existing = os.O_TRUNC if replace else os.O_EXCL
            self._file = os.open(path, os.O_WRONLY | os.O_CREAT | existing | os.O_CLOEXEC, 0o644)
        except OSError as error:
            raise BadInput(f"{path}: cannot be written: {error.strerror}") from None
        self._size = 0
        self._write((notes + header).encode())

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        os.close(self._file)

    def add(self, samples: NDArray[Any], until_s: float = float("inf")) -> bool:
        """Append (n,) TELEMETRY records, ascending, up to and without the time until_s; True when
        that time has come. Raises RecordingFailed when the disk is full or gone; the file then
        ends with a whole line."""
        if not samples.size:
            return False
        if self._first_ns is None:
            self._first_ns = int(samples["scheduled_ns"][0])
        t_s = (samples["scheduled_ns"] - self._first_ns) / 1e9
        if (self.rows and t_s[0] <= self.time_s) or np.any(np.diff(t_s) <= 0):
            raise RecordingFailed(
                f"{self.path}: the daemon's clock started anew (a reboot?); the recording ends "
                f"after {self.rows} samples"
            )
        keep = t_s < until_s
        done = not keep.all()
        samples, t_s = samples[keep], t_s[keep]
        if not samples.size:
            return done
        drive = self._drive(samples)
        columns = (
            t_s,
            drive,
            samples["measured"] + self._origin,
            samples["target"] + self._origin,
            samples["trim"],
            samples["learned"],
            samples["flags"],
        )
        lines = [
            f"{t!r},{_text(u)},{_text(y)},{_text(target)},{trim!r},{learned!r},{flags}\n"
            for t, u, y, target, trim, learned, flags in zip(
                *(c.tolist() for c in columns), strict=True
            )
        ]
        self._write("".join(lines).encode())
        self.rows += samples.size
        self.time_s = float(t_s[-1])
        self._before = samples[-1].copy()
        return done

    def _drive(self, samples: NDArray[Any]) -> NDArray[np.float64]:
        """Drive in force at each reading: the voltage of the sample before, NaN after a gap."""
        out = np.full(samples.size, np.nan)
        out[1:] = samples["volts"][:-1]
        follows = np.diff(samples["seq"]) == 1
        out[1:][~follows] = np.nan
        self.gaps += int(np.count_nonzero(~follows))
        if self._before is not None:
            if int(self._before["seq"]) + 1 == int(samples["seq"][0]):
                out[0] = self._before["volts"]
            else:
                self.gaps += 1
        return np.asarray(out / self._gain)

    def _write(self, data: bytes) -> None:
        left = memoryview(data)
        try:
            while left:
                left = left[os.write(self._file, left) :]
        except OSError as error:
            self._back_to_whole_line(data[: len(data) - len(left)])
            raise RecordingFailed(
                f"{self.path}: {error.strerror}; the recording ends here, what was written before "
                "is whole"
            ) from None
        self._size += len(data)

    def _back_to_whole_line(self, written: bytes) -> None:
        whole = written.rfind(b"\n") + 1
        self.rows += written[:whole].count(b"\n") if self._size else 0
        try:
            os.ftruncate(self._file, self._size + whole)
        except OSError:
            return  # the disk is gone: the reader will name the broken line


def _text(value: float) -> str:
    return "" if value != value else repr(value)
