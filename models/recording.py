"""A recording: time, drive, displacement and further channels. Pure data.

Nothing is resampled or filled in. A missing sample is a NaN in its column or a gap in the time
stamps. Both are counted here; the calculation that uses the recording decides how to treat them.
"""

import re
from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import cached_property

import numpy as np
from numpy.typing import ArrayLike, NDArray

from dehyst.models.arrays import Bools, Floats
from dehyst.models.errors import BadRecording
from dehyst.models.units import how_many

AXIS_CHANNEL = re.compile(r"axis\.([a-z0-9]{1,8})(\.drive)?")
"""Channels of another axis of the same controller: `axis.y` is its displacement, `axis.y.drive` its
drive."""

GAP_PERIODS = 1.6  # time stamps more than this many periods apart have a gap between them


def _column(values: ArrayLike, size: int, what: str) -> Floats:
    out = np.ascontiguousarray(values, dtype=np.float64)
    if out.ndim != 1 or (size >= 0 and out.size != size):
        raise BadRecording(f"{what}: {out.size} values where {size} are needed")
    if out.flags.writeable:
        out = out.view()
        out.flags.writeable = False
    return out


@dataclass(frozen=True)
class Recording:
    """One measured run.

    t_s: (N,) time stamps [s], finite and strictly increasing; drive: (N,) [drive_unit], NaN where
    missing; displacement: (N,) [displacement_unit] or None; channels: further columns by name,
    each (N,); metadata: the file's own metadata; name, sha256: the file it came from; read: how a
    file of another program was interpreted, in one line.
    Raises BadRecording on unequal lengths and on time that does not increase.
    """

    t_s: Floats
    drive: Floats
    displacement: Floats | None = None
    drive_unit: str = "v"
    displacement_unit: str = "um"
    channels: Mapping[str, Floats] = field(default_factory=dict)
    metadata: Mapping[str, str] = field(default_factory=dict)
    name: str = "recording"
    sha256: str = ""
    read: str = ""

    def __post_init__(self) -> None:
        object.__setattr__(self, "t_s", _column(self.t_s, -1, f"{self.name}: t_s"))
        n = self.t_s.size
        object.__setattr__(self, "drive", _column(self.drive, n, f"{self.name}: drive"))
        if self.displacement is not None:
            y = _column(self.displacement, n, f"{self.name}: displacement")
            object.__setattr__(self, "displacement", y)
        channels = {key: _column(v, n, f"{self.name}: {key}") for key, v in self.channels.items()}
        object.__setattr__(self, "channels", channels)
        object.__setattr__(self, "metadata", dict(self.metadata))
        row = first_not_increasing(self.t_s)
        if row >= 0:
            raise BadRecording(f"{self.name}: t_s does not increase at sample {row}")

    @property
    def size(self) -> int:
        """Number of rows."""
        return int(self.t_s.size)

    @cached_property
    def period_s(self) -> float:
        """Sampling period: the mean step of the time stamps, excluding gaps [s]."""
        return typical_step(self.t_s)

    @cached_property
    def missing_drive(self) -> Bools:
        """(N,) True where the drive is NaN."""
        return np.isnan(self.drive)

    @cached_property
    def missing_displacement(self) -> Bools:
        """(N,) True where the displacement is NaN; True everywhere if there is no displacement."""
        if self.displacement is None:
            return np.ones(self.size, dtype=bool)
        return np.isnan(self.displacement)

    @cached_property
    def gaps(self) -> NDArray[np.intp]:
        """Rows that are followed by a gap: t[i + 1] - t[i] > 1.6 periods."""
        return np.flatnonzero(np.diff(self.t_s) > GAP_PERIODS * self.period_s)

    @property
    def drive_column(self) -> str:
        """Name of the drive's column in a file, such as "u_v"."""
        return f"u_{self.drive_unit}"

    @property
    def displacement_column(self) -> str:
        """Name of the displacement's column in a file, such as "y_um"."""
        return f"y_{self.displacement_unit}"

    def defects(self) -> str:
        """Return one sentence that lists what is missing; "" if nothing is."""
        parts = []
        if n := int(self.missing_drive.sum()):
            parts.append(f"{how_many(n, 'drive value')} missing")
        if self.displacement is not None and (n := int(self.missing_displacement.sum())):
            parts.append(f"{how_many(n, 'displacement value')} missing")
        if n := int(self.gaps.size):
            longest = float(np.diff(self.t_s)[self.gaps].max())
            gaps = how_many(n, "gap in time of", "gaps in time, the longest")
            parts.append(f"{gaps} {longest:.4g} s")
        return f"{self.name}: {', '.join(parts)}" if parts else ""


@dataclass(frozen=True)
class Trajectory:
    """Targets of a stage over time. t_s [s], target [unit]: (N,), finite, time strictly increasing;
    channels: further columns by name, each (N,); read: how its file was interpreted."""

    t_s: Floats
    target: Floats
    unit: str = "um"
    name: str = "trajectory"
    sha256: str = ""
    channels: Mapping[str, Floats] = field(default_factory=dict)
    read: str = ""

    def __post_init__(self) -> None:
        object.__setattr__(self, "t_s", _column(self.t_s, -1, f"{self.name}: t_s"))
        object.__setattr__(
            self, "target", _column(self.target, self.t_s.size, f"{self.name}: target")
        )
        n = self.t_s.size
        channels = {key: _column(v, n, f"{self.name}: {key}") for key, v in self.channels.items()}
        object.__setattr__(self, "channels", channels)
        row = first_not_increasing(self.t_s)
        if row >= 0:
            raise BadRecording(f"{self.name}: t_s does not increase at sample {row}")
        if not np.all(np.isfinite(self.target)):
            row = int(np.flatnonzero(~np.isfinite(self.target))[0])
            raise BadRecording(f"{self.name}: target_{self.unit} is missing at sample {row}")

    @cached_property
    def period_s(self) -> float:
        """Mean step of the time stamps, excluding gaps [s]."""
        return typical_step(self.t_s)


def typical_step(t_s: Floats) -> float:
    """Return the mean step of time stamps, excluding gaps [s]; NaN with fewer than two stamps.

    The median alone would be affected by rounding where stamps were written with few digits.
    """
    if t_s.size < 2:
        return float("nan")
    steps = np.diff(t_s)
    middle = np.median(steps)
    # shorter steps than half the median are jitter
    return float(np.mean(steps[(steps >= 0.5 * middle) & (steps <= GAP_PERIODS * middle)]))


def first_not_increasing(t_s: Floats) -> int:
    """Return the first row whose time is not finite or not after the previous row's; -1: none."""
    if t_s.size and not np.isfinite(t_s[0]):
        return 0
    bad = ~(t_s[1:] > t_s[:-1])
    if not bad.any() and (t_s.size == 0 or np.isfinite(t_s[-1])):
        return -1
    return int(np.argmax(bad)) + 1 if bad.any() else int(t_s.size) - 1
