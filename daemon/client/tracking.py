"""Computes from the telemetry how well a trajectory was followed. Pure."""

from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from dehyst.daemon.rings.records import Flag, State


@dataclass
class Tracking:
    """Statistics over a trajectory's own samples, without the approach to its first point.

    first_seq: earlier samples do not belong to it; expected: number of samples of the trajectory.
    dry: samples for which the inverse fell back, e.g. because no points arrived in time.
    Errors are measured minus target, in the displacement unit, over samples with a valid reading.
    """

    first_seq: int
    expected: int
    samples: int = 0
    valid: int = 0
    square_sum: float = 0.0
    max_error: float = 0.0
    unreachable: int = 0
    slew_limited: int = 0
    outside_validity: int = 0
    missed: int = 0
    invalid: int = 0
    dry: int = 0
    approaching: bool = field(default=False, repr=False)
    _begun: bool = field(default=False, repr=False)

    @property
    def complete(self) -> bool:
        """Return True once all samples of the trajectory have been seen."""
        return self.samples >= self.expected

    @property
    def rms_error(self) -> float:
        """Return the rms of measured minus target; NaN without a valid reading."""
        return float(np.sqrt(self.square_sum / self.valid)) if self.valid else float("nan")

    def add(self, samples: NDArray[Any]) -> NDArray[Any]:
        """Add the next (n,) TELEMETRY records; return those that belong to the trajectory."""
        samples = samples[samples["seq"] >= self.first_seq]
        approach = (samples["flags"] & Flag.APPROACH) != 0
        running = samples["state"] == State.RUNNING
        if not self._begun:
            # the loop flags at least one sample of every trajectory as approach
            flagged = np.flatnonzero(approach)
            if not flagged.size and not self.approaching:
                return samples[:0]
            start = 0 if self.approaching else int(flagged[0])
            self.approaching = True
            after = np.flatnonzero(~approach[start:] & running[start:])
            if not after.size:
                return samples[:0]
            self._begun, self.approaching = True, False
            samples = samples[start + int(after[0]) :]
            running = samples["state"] == State.RUNNING
        samples = samples[running & np.isfinite(samples["target"])]
        samples = samples[: self.expected - self.samples]
        self._count(samples)
        return samples

    def _count(self, samples: NDArray[Any]) -> None:
        flags = samples["flags"]
        self.samples += samples.size
        self.unreachable += int(np.count_nonzero(flags & Flag.UNREACHABLE))
        self.slew_limited += int(np.count_nonzero(flags & Flag.SLEW))
        self.outside_validity += int(np.count_nonzero(flags & Flag.OUTSIDE_VALIDITY))
        self.dry += int(np.count_nonzero(flags & Flag.FALLBACK))
        self.missed += int(np.count_nonzero(flags & Flag.MISSED))
        valid = np.isfinite(samples["measured"]) & ((flags & Flag.SENSOR_INVALID) == 0)
        self.invalid += int(samples.size - np.count_nonzero(valid))
        error = np.abs(samples["measured"][valid] - samples["target"][valid])
        if error.size:
            self.valid += error.size
            self.square_sum += float(np.dot(error, error))
            self.max_error = max(self.max_error, float(error.max()))
