"""What clients make of telemetry: means of samples, trajectories with all their samples, and the
present state of each axis of a controller."""

import math
import threading
from dataclasses import dataclass, replace
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from dehyst.daemon import clock
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


@dataclass(frozen=True)
class AxisView:
    """State of an axis. Displacements are in its unit from the set-point origin, NaN if there is no
    value. asked: the last target; place: its position (the gauge's mean over the newest settle_s,
    else the model's); low, high: its reach; lost: why it is no longer held, "" if it is held or was
    never sent anywhere."""

    unit: str
    period_s: float
    low: float
    high: float
    tolerance: float
    asked: float = np.nan
    place: float = np.nan
    predicted: float = np.nan
    volts: float = np.nan
    on_target: bool = False
    moving: bool = False
    flying: bool = False
    lost: str = ""


class AxisViews:
    """The present state of each axis, from its telemetry. settle_s: how long an axis must stay
    within its tolerance to be on target; by: what decides that, the model or the gauge. `look` may
    be called from any thread, the rest from one."""

    def __init__(self, settle_s: float, by: Literal["model", "gauge"]) -> None:
        self._settle_ns, self._by = round(settle_s * clock.NS), by
        self._views: dict[str, AxisView] = {}
        self._near_since_ns: dict[str, int] = {}
        self._lock = threading.Lock()

    def look(self) -> dict[str, AxisView]:
        """Return the view of each axis."""
        with self._lock:
            return dict(self._views)

    def change(self, axis: str, **known: Any) -> None:
        """Set fields of an axis' view, which begins with those that have no default."""
        with self._lock:
            old = self._views.get(axis)
            self._views[axis] = replace(old, **known) if old else AxisView(**known)

    def expect(self, axis: str, value: float) -> None:
        """Note that an axis moves to a target, and then stays there."""
        self._near_since_ns[axis] = 0
        self.change(axis, asked=value, on_target=False, moving=True, flying=False, lost="")

    def hear(self, axis: str, samples: NDArray[Any], target: float | None) -> None:
        """Take new samples of an axis, at least one. target: where it is kept; None: nowhere."""
        model, times_ns = model_place(samples), samples["scheduled_ns"]
        # a late batch also contains samples of the motion
        recent = samples[times_ns >= times_ns[-1] - self._settle_ns]["measured"]
        gauge = recent[np.isfinite(recent)]
        self.change(
            axis,
            place=float(gauge.mean()) if gauge.size else float(model[-1]),
            predicted=float(model[-1]),
            volts=float(samples["volts"][-1]),
        )
        if target is not None and not self.look()[axis].flying:
            place = samples["measured"] if self._by == "gauge" else model
            self._judge(axis, samples, place, target)

    def _judge(
        self, axis: str, samples: NDArray[Any], place: NDArray[np.float64], target: float
    ) -> None:
        """Check whether the axis has been on target without a break for settle_s."""
        since_ns = self._near_since_ns.get(axis, 0)
        near = (samples["target"] == target) & (
            np.abs(place - target) <= self.look()[axis].tolerance
        )
        last_ns = int(samples["scheduled_ns"][-1])
        if not near.all():  # count from the sample after the last one outside the tolerance
            away = int(np.flatnonzero(~near)[-1])
            since_ns = 0 if away == near.size - 1 else int(samples["scheduled_ns"][away + 1])
        else:
            since_ns = since_ns or int(samples["scheduled_ns"][0])
        self._near_since_ns[axis] = since_ns
        there = since_ns > 0 and last_ns - since_ns >= self._settle_ns
        self.change(axis, on_target=there, moving=not there)
