"""Telemetry of several axes of one loop, brought together sample by sample. Pure."""

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from dehyst.daemon.rings.records import TELEMETRY


class JoinedTelemetry:
    """Holds what has come of each axis until it has come of all: they are sampled at the same
    moments, and arrive one after the other. It begins with the first moment that all have, and so
    again where their clock starts anew (a reboot). axes: their names."""

    def __init__(self, axes: Sequence[str]) -> None:
        self._waiting: dict[str, NDArray[Any]] = {axis: np.zeros(0, TELEMETRY) for axis in axes}
        self._first_ns: dict[str, int] = {}
        self._newest_ns: dict[str, int] = dict.fromkeys(axes, -1)

    def add(self, axis: str, samples: NDArray[Any]) -> None:
        """(n,) TELEMETRY records of one axis, ascending."""
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
        """What is there of every axis, by axis, and not given before; end: all that is held."""
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
    """(n,) records of another axis at the moments of these (n,), NaN where there is none."""
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
