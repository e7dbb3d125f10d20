"""What the doctor is given: the last good recording, the flagged one, and what came after.

Called by the mismatch watch's thread. While the stage is in order and moves, a short stretch of
telemetry is kept now and then; the newest that ended well before the flag is the good one.
"""

from collections import deque
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from dehyst.daemon.bus.messages import new_number
from dehyst.daemon.config import Config
from dehyst.daemon.files.cases import (
    CASE,
    FLAGGED,
    GOOD,
    IN_USE,
    LATER,
    Case,
    case_folder,
    put_record,
)
from dehyst.daemon.files.models import load_model, save_model
from dehyst.daemon.files.recorder import Recorder
from dehyst.daemon.gateway.history import TelemetryHistory
from dehyst.models.errors import DehystError

GOOD_S, EVERY_S, SPARE_S = 20.0, 8, 12.0
"""Length of a good stretch; seconds of motion between two; what lies closer to the flag than this
may have had the mismatch in it already."""
MOST_ROWS = 60_000
STRETCHES = 4


class CaseKeeper:
    """Writes cases. history: where telemetry of the last minute is."""

    def __init__(self, config: Config, history: TelemetryHistory) -> None:
        self._config, self._history = config, history
        self._rate_hz = 1e9 / config.period_ns
        self._good: deque[NDArray[Any]] = deque(maxlen=STRETCHES)
        self._motion_s = 0
        self._folder: Path | None = None
        self._origin, self._first, self._end = 0.0, 0, -1

    def restart(self) -> None:
        """Another run or another model: nothing is known to be good, no case is open."""
        self._good.clear()
        self._motion_s, self._end = 0, -1

    def in_order(self, seq: int, motion_s: int) -> None:
        """The stage is in order at this sample, and has moved for so long in all."""
        if motion_s - self._motion_s < EVERY_S:
            return
        self._motion_s = motion_s
        count = min(MOST_ROWS, round(GOOD_S * self._rate_hz))
        self._good.append(self._history.get(seq + 1 - count, seq + 1))

    def begin(self, recording: Path, flagged: int, end: int, origin: float, case: Case,
              model: Path) -> None:  # fmt: skip
        """The recording around the mismatch is complete: a case. flagged: sample of the flag; end:
        its last one. Raises OSError, DehystError."""
        folder = case_folder(recording)
        folder.mkdir(parents=True)
        good = self._last_good(flagged)
        if good is not None:
            self._write(folder / GOOD, good, origin, model)
        self._write(folder / FLAGGED, self._history.get(flagged, end + 1), origin, model)
        save_model(load_model(model), folder / IN_USE)
        put_record(folder, CASE, case)
        self._folder, self._origin, self._first = folder, origin, end + 1
        self._end = end + round(case.later_s * self._rate_hz)

    def _last_good(self, flagged: int) -> NDArray[Any] | None:
        before = flagged - round(SPARE_S * self._rate_hz)
        fit = [s for s in self._good if s.size and int(s["seq"][-1]) <= before]
        return fit[-1] if fit else None

    def go_on(self, seq: int, model: Path) -> None:
        """Telemetry has come to this sample: what came after the recording is complete now?"""
        if self._folder is None or self._end < 0 or seq < self._end:
            return
        end, self._end = self._end, -1
        try:
            samples = self._history.get(self._first, end + 1)
            self._write(self._folder / LATER, samples, self._origin, model)
        except (OSError, DehystError):
            return  # the doctor does not find it, and offers nothing

    def _write(self, path: Path, samples: NDArray[Any], origin: float, model: Path) -> None:
        """Under another name first: the doctor reads what has its own."""
        known = load_model(model)
        part = path.with_name(f"part-{path.name}")
        units = (known.drive_unit, known.displacement_unit)
        with Recorder(part, self._config.actuator.gain, units, origin, {}, replace=True) as out:
            out.add(samples)
        part.replace(path)


def describe_case(config: Config, name: str, figure: str, when: tuple[int, int]) -> Case:
    """A new case with the limits of the stage's drive. when: (time_ns, wall_ns) of the flag."""
    gain, limits = config.actuator.gain, config.limits
    low, high = np.sort(np.array([limits.min_v, limits.max_v]) / gain)
    return Case(
        number=new_number(),
        name=name,
        time_ns=when[0],
        wall_ns=when[1],
        figure=figure,
        low=float(low),
        high=float(high),
        slew=limits.slew_v_per_s / abs(gain),
        rate_hz=1e9 / config.period_ns,
        later_s=config.doctor.test_s,
    )
