"""Learns while a trajectory is played: turns telemetry into corrections of the coming points.

The arithmetic is in dehyst.models.learning.passes. A new correction applies from the next point
that is not sent yet and is faded in; the correction applied at each sample is kept with its pass.
"""

from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import NDArray

from dehyst.daemon.client.repeated import Numbers
from dehyst.daemon.rings.records import Flag
from dehyst.models.learning.late_gauge import LateGauge
from dehyst.models.learning.passes import Learner, Outcome, Pass, fade_share
from dehyst.models.learning.tuning import TUNING
from dehyst.models.recording import Floats

UNUSABLE = Flag.SENSOR_INVALID | Flag.MISSED


class Outputs:
    """Keeps sizes and times of the last `back` output steps before each reading."""

    def __init__(self, n: int, back: int) -> None:
        self.n, self.back = n, back
        self._kept: dict[int, Floats] = {}  # (3, n) by pass: volts, written, read [s]

    def put(self, pass_number: int, samples: NDArray[Any], place: Numbers) -> None:
        """Store samples of a pass."""
        kept = self._kept.setdefault(pass_number, np.full((3, self.n), np.nan))
        read_s = samples["actual_ns"] * 1e-9  # the gauge is read first, the output is set last
        kept[0, place] = np.where(samples["flags"] & int(UNUSABLE), np.nan, samples["volts"])
        kept[1, place], kept[2, place] = read_s + samples["exec_us"] * 1e-6, read_s

    def steps_of_pass(self, number: int) -> tuple[Floats, Floats]:
        """Return the (n, back) output steps before each reading, newest first, and how long before
        it each was set [s]. NaN if unknown. The previous pass is discarded."""
        nothing = np.full((3, self.n), np.nan)
        earlier, own = self._kept.pop(number - 1, nothing), self._kept.get(number, nothing)
        volts, written, read = np.concatenate([earlier, own], axis=1)
        at = np.arange(self.n, 2 * self.n)[:, None] - np.arange(1, self.back + 1)
        at = np.maximum(at, 1)
        return volts[at] - volts[at - 1], read[self.n :, None] - written[at]


class LessonTaker:
    """Feeds the learner while a trajectory plays, n points per pass, one point per period.

    learner: of this trajectory; targets: (n,) of a pass; expected: (n,) expected gauge readings in
    a pass; period_ns: the loop's. on_outcome: called with the outcome of each pass; late: for a
    gauge whose filter is known. `errors`: (n,) errors of the first and the newest complete pass.
    """

    def __init__(
        self,
        learner: Learner,
        targets: Floats,
        expected: Floats,
        period_ns: int,
        on_outcome: Callable[[Outcome], None],
        late: LateGauge | None = None,
    ) -> None:
        self._late, self._outputs = late, Outputs(learner.n, late.back if late else 0)
        self.learner, self._expected, self._on_outcome = learner, expected, on_outcome
        self._targets = targets
        # the largest step between two points, with room for rounding
        self._step = 1.01 * float(np.abs(np.diff(targets, append=targets[0])).max()) + 1e-9
        self.n, self._period_ns = learner.n, period_ns
        self.start_ns = 0  # the loop's time of point 0; 0: not known yet
        self.errors: list[Floats] = []  # of the first and the newest pass
        self._old = self._new = learner.correction
        self._since = self._sent = 0
        self._used: dict[int, Floats] = {}
        self._error: dict[int, Floats] = {}
        self._held: dict[int, NDArray[np.bool_]] = {}
        self._trimmed = False
        self._done = 0  # completed passes
        self._waiting: list[NDArray[Any]] = []
        self._fade = round(TUNING.fade_s * 1e9 / period_ns)

    def correct(self, numbers: Numbers) -> Floats:
        """Return the (m,) corrections of the points being sent, which follow the previous ones."""
        place = numbers % self.n
        share = fade_share(numbers - self._since, self._fade)
        out = self._old[place] + share * (self._new[place] - self._old[place])
        for number in range(int(numbers[0]) // self.n, int(numbers[-1]) // self.n + 1):
            mine = numbers // self.n == number
            self._used.setdefault(number, np.zeros(self.n))[place[mine]] = out[mine]
        self._sent = int(numbers[-1]) + 1
        return np.asarray(out, np.float64)

    def add(self, samples: NDArray[Any]) -> None:
        """Add (m,) TELEMETRY records of this trajectory."""
        self._waiting.append(samples)
        if self.start_ns <= 0:
            return
        samples, self._waiting = np.concatenate(self._waiting), []
        number = np.round((samples["scheduled_ns"] - self.start_ns) / self._period_ns).astype(int)
        mine = (number >= 0) & np.isfinite(samples["target"])
        samples, number = samples[mine], number[mine]
        for pass_number in np.unique(number // self.n).tolist():
            if pass_number >= self._done:
                here = number // self.n == pass_number
                self._put(int(pass_number), samples[here], number[here] % self.n)
        while number.size and number[-1] >= (self._done + 1) * self.n - 1:
            self._finish()

    def _put(self, pass_number: int, samples: NDArray[Any], place: Numbers) -> None:
        error = self._error.setdefault(pass_number, np.full(self.n, np.nan))
        held = self._held.setdefault(pass_number, np.zeros(self.n, np.bool_))
        good = (samples["flags"] & int(UNUSABLE)) == 0
        # if the loop held the axes of a group, point 0 is later than last reported
        good &= np.abs(samples["target"] - self._targets[place]) <= self._step
        held[place] = good & ((samples["flags"] & int(Flag.SENSOR_HELD)) != 0)
        error[place] = np.where(good, samples["measured"] - self._expected[place], np.nan)
        self._trimmed = bool(samples["trim"][-1])
        if self._late is not None:
            self._outputs.put(pass_number, samples, place)

    def _finish(self) -> None:
        """Evaluate a complete pass and pass it to the learner."""
        nothing = np.full(self.n, np.nan)
        error = self._error.pop(self._done, nothing)
        held = self._held.pop(self._done, np.zeros(self.n, np.bool_))
        used = self._used.pop(self._done, np.zeros(self.n))
        self._done += 1
        fresh = np.isfinite(error) & ~held
        if held.any() and fresh.any():  # interpolate between readings of a slower gauge
            places = np.arange(self.n)
            error[held] = np.interp(places[held], places[fresh], error[fresh])
        error_redefined = False
        if self._late is not None and not held.any():
            ahead = self._late.take(error - used, *self._outputs.steps_of_pass(self._done - 1))
            error, error_redefined = error + ahead, self._late.error_redefined
        outcome = self.learner.take(Pass(error, used, self._trimmed, error_redefined))
        if np.isfinite(error).any():
            self.errors = [*self.errors[:1], error]
        self._old = self._in_force()
        self._new, self._since = self.learner.correction, self._sent
        self._on_outcome(outcome)

    def _in_force(self) -> Floats:
        """Return the correction at the next point, from which the fade to a new one begins."""
        share = fade_share(np.array([self._sent - self._since]), self._fade)
        return np.asarray(self._old + share * (self._new - self._old), np.float64)
