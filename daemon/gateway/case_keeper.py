"""Writes the doctor's cases: the last good recording, the flagged one, and the one after it.

Called by the mismatch watch's thread. While the stage matches its model and moves, a short stretch
of telemetry is kept at intervals; the newest that ended well before the flag is the good one. Each
recording begins with a lead (Case.leads), since a stage with hysteresis depends on its past.
"""

from collections import deque
from pathlib import Path
from typing import Any

import msgspec
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
"""Length of a good stretch [s]; motion between two [s]; time before the flag [s] in which the
mismatch may already have been present."""
LEAD_S = 25.0
"""Lead before each recording [s], as far as the history goes."""
MOST_ROWS = 60_000  # longest good stretch and longest lead
STRETCHES = 4  # newest good stretches that are kept for a case


class CaseKeeper:
    """Writes cases. history: telemetry of the last minute."""

    def __init__(self, config: Config, history: TelemetryHistory) -> None:
        self._config, self._history = config, history
        self._rate_hz = 1e9 / config.period_ns
        self._good: deque[NDArray[Any]] = deque(maxlen=STRETCHES)
        self._motion_s = self._good_from = 0
        self._folder: Path | None = None
        self._origin, self._first, self._end = 0.0, 0, -1
        self._lead = min(MOST_ROWS, round(LEAD_S * self._rate_hz))

    def restart(self) -> None:
        """Forget good stretches and the open case, after a new run or a new model."""
        self._good.clear()
        self._motion_s, self._good_from, self._end = 0, 0, -1

    def note_mismatch(self, seq: int, wrong: bool) -> None:
        """Note that a mismatch begins or ends at sample `seq`. From SPARE_S before its flag to its
        end nothing is good: a stage that rests, or is moved slowly, matches its model again while
        the cause is still there."""
        if wrong:
            self._good = deque(self._well_before(seq), maxlen=STRETCHES)
        else:
            self._good_from = seq

    def keep_good_stretch(self, seq: int, motion_s: int) -> None:
        """Keep a good stretch if due: the stage matches its model at sample `seq` and has moved
        for `motion_s` in total."""
        count = min(MOST_ROWS, round(GOOD_S * self._rate_hz))
        if motion_s - self._motion_s < EVERY_S or 0 < self._good_from > seq + 1 - count:
            return
        self._motion_s = motion_s
        self._good.append(self._history.get(seq + 1 - count - self._lead, seq + 1))

    def begin(
        self, recording: Path, flagged: int, end: int, origin: float, case: Case, model: Path
    ) -> None:
        """Open a case once the recording around the mismatch is complete. flagged: sample of the
        flag; end: last sample of the recording. Raises OSError, DehystError."""
        folder = case_folder(recording)
        folder.mkdir(parents=True)
        stretches, leads = self._well_before(flagged), {}
        if stretches:
            good = stretches[-1]
            count = min(MOST_ROWS, round(GOOD_S * self._rate_hz))
            leads[GOOD] = self._write(
                folder / GOOD, good, int(good["seq"][-1]) + 1 - count, origin, model
            )
        samples = self._history.get(flagged - self._lead, end + 1)
        leads[FLAGGED] = self._write(folder / FLAGGED, samples, flagged, origin, model)
        save_model(load_model(model), folder / IN_USE)
        leads[LATER] = leads[FLAGGED] + (end + 1 - flagged) / self._rate_hz
        put_record(folder, CASE, msgspec.structs.replace(case, leads=leads))
        self._folder, self._origin, self._first = folder, origin, flagged - self._lead
        self._end = end + round(case.later_s * self._rate_hz)

    def _well_before(self, flagged: int) -> list[NDArray[Any]]:
        """Return the stretches that ended SPARE_S or more before this sample, the newest last."""
        before = flagged - round(SPARE_S * self._rate_hz)
        return [s for s in self._good if s.size and int(s["seq"][-1]) <= before]

    def write_later_recording(self, seq: int, model: Path) -> None:
        """Write the recording after the mismatch, once telemetry has reached its end at `seq`."""
        if self._folder is None or self._end < 0 or seq < self._end:
            return
        end, self._end = self._end, -1
        try:
            samples = self._history.get(self._first, end + 1)
            self._write(self._folder / LATER, samples, self._first, self._origin, model)
        except (OSError, DehystError):
            return  # without this file the doctor offers nothing

    def _write(
        self, path: Path, samples: NDArray[Any], first: int, origin: float, model: Path
    ) -> float:
        """Write under a temporary name, then rename, as the doctor reads files under the final
        name. first: first sample after the lead. Return the length of the lead [s]."""
        known = load_model(model)
        part = path.with_name(f"part-{path.name}")
        units = (known.drive_unit, known.displacement_unit)
        with Recorder(part, self._config.actuator.gain, units, origin, {}, replace=True) as out:
            out.add(samples)
        part.replace(path)
        lead = samples[samples["seq"] < first]
        return float((first - lead["seq"][0]) / self._rate_hz) if lead.size else 0.0


def describe_case(config: Config, name: str, figure: str, when: tuple[int, int]) -> Case:
    """Return a new case with the stage's drive limits. when: (time_ns, wall_ns) of the flag."""
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
