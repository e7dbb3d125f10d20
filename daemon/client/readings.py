"""Results of a positioner: means of samples, and trajectories with all their samples."""

import math
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from dehyst.daemon.client.player import Played
from dehyst.daemon.rings.records import Flag


@dataclass(frozen=True)
class Reading:
    """Means over some samples, NaN if there is no value. Displacements are in the stage's unit from
    the set-point origin; wall_s: time of the last sample, seconds since 1970; spread: standard
    deviation of the gauge readings; missed: number of missed deadlines; by: what decided that the
    stage has arrived, "" for a reading without a move; agrees: the gauge confirms the position,
    within the tolerance and its own noise."""

    measured: float
    spread: float
    target: float
    predicted: float
    volts: float
    wall_s: float
    samples: int
    missed: int
    by: str = ""
    agrees: bool = True

    @property
    def finite(self) -> bool:
        """Return whether the gauge gave a valid reading at all."""
        return math.isfinite(self.measured)

    @property
    def error(self) -> float:
        """Return measured minus target; NaN if either is missing."""
        return self.measured - self.target


@dataclass(frozen=True)
class Flight:
    """A trajectory that was played. samples: (n,) TELEMETRY records without the approach; wall_s:
    (n,) seconds since 1970."""

    played: Played
    samples: NDArray[Any]
    wall_s: NDArray[np.float64]


def model_place(samples: NDArray[Any]) -> NDArray[np.float64]:
    """Return the position predicted by the model, without trim and learned correction, on the scale
    of the set-points."""
    return np.asarray(samples["predicted"] - samples["trim"] - samples["learned"])


def mean_of(samples: NDArray[Any], wall_offset_ns: int) -> Reading:
    """Return the means of (n,) TELEMETRY records."""
    return Reading(
        measured=_mean(samples["measured"]),
        spread=float(np.nanstd(samples["measured"]))
        if np.isfinite(samples["measured"]).any()
        else float("nan"),
        target=_mean(samples["target"]),
        predicted=_mean(samples["predicted"]),
        volts=_mean(samples["volts"]),
        wall_s=float(samples["scheduled_ns"][-1] + wall_offset_ns) * 1e-9,
        samples=int(samples.size),
        missed=int(np.count_nonzero(samples["flags"] & int(Flag.MISSED))),
    )


def _mean(values: NDArray[np.float64]) -> float:
    known = values[np.isfinite(values)]
    return float(known.mean()) if known.size else float("nan")
