"""Join the telemetry of several axes of one loop sample by sample. Pure."""

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from dehyst.daemon.rings.records import TELEMETRY


class JoinedTelemetry:
    """Holds samples of each axis until those of all axes have arrived: the axes are sampled at the
    same times, but their records arrive one after the other. Output begins with the first time that
    all axes have, and begins again when their clock restarts (a reboot). axes: their names."""

    def __init__(self, axes: Sequence[str]) -> None:
        self._waiting: dict[str, NDArray[Any]] = {axis: np.zeros(0, TELEMETRY) for axis in axes}
        self._first_ns: dict[str, int] = {}
        self._newest_ns: dict[str, int] = dict.fromkeys(axes, -1)

    def add(self, axis: str, samples: NDArray[Any]) -> None:
        """Add (n,) TELEMETRY records of one axis, in ascending order."""
        if samples.size:
            if samples["scheduled_ns"][0] <= self._newest_ns[axis]:
                self._begin_anew()
            self._waiting[axis] = np.concatenate([self._waiting[axis], samples])
            self._first_ns.setdefault(axis, int(samples["scheduled_ns"][0]))
            self._newest_ns[axis] = int(samples["scheduled_ns"][-1])

    def _begin_anew(self) -> None:
        for axis in self._waiting:
            self._waiting[axis] = self._waiting[axis][:0]
            self._newest_ns[axis] = -1
        self._first_ns.clear()

    def take(self, end: bool = False) -> dict[str, NDArray[Any]]:
        """Return the records that are available for every axis and were not returned before, by
        axis. end: return all that is held."""
        if len(self._waiting) == 1:
            axis, held = next(iter(self._waiting.items()))
            self._waiting[axis] = held[:0]
            return {axis: held}
        until_ns = max(self._newest_ns.values()) if end else min(self._newest_ns.values())
        begin_ns = max(self._first_ns.values(), default=0)
        out = {}
        for axis, held in self._waiting.items():
            cut = int(np.searchsorted(held["scheduled_ns"], until_ns, side="right"))
            first = int(np.searchsorted(held["scheduled_ns"], begin_ns))
            out[axis], self._waiting[axis] = held[min(first, cut) : cut], held[cut:]
        return out


def at_the_same_time(samples: NDArray[Any], other: NDArray[Any]) -> NDArray[Any]:
    """Return (n,) records of another axis at the times of these (n,) samples, NaN where there is
    none."""
    out = np.zeros(samples.size, TELEMETRY)
    for name in TELEMETRY.names or ():
        if TELEMETRY[name].kind == "f":
            out[name] = np.nan
    if other.size:
        times = other["scheduled_ns"]
        place = np.minimum(np.searchsorted(times, samples["scheduled_ns"]), times.size - 1)
        there = times[place] == samples["scheduled_ns"]
        out[there] = other[place[there]]
    return out
