"""Recordings of one stage, joined: one array per quantity for all recordings.

`starts` marks where a recording, or the part after a long gap, begins; every filter restarts there.
`forgets` marks where and how the memory of the drive's path restarts (`signals.pasts`); after a gap
it continues.
"""

from dataclasses import dataclass, field, fields, replace

import numpy as np

from dehyst.models.arrays import Bools, Floats, Ints


@dataclass(frozen=True)
class Data:
    """Joined recordings. Arrays (N,), channels (N,) each; units are the recordings' own."""

    names: tuple[str, ...]
    t: Floats  # s, within its recording
    dt: Floats  # s, sampling period of the sample's recording
    u: Floats
    y: Floats
    rec: Ints  # index into names
    part: Ints  # contiguous stretch: a recording, or the part between two gaps
    starts: Bools
    forgets: Ints  # 0: the memory continues; else how it restarts, see signals.pasts
    rows: Bools  # included in the fits
    heads: Bools  # excluded from the fits, since the stage's earlier history is unknown
    block: Ints  # time block, unique over the recordings
    fold: Ints  # cross-validation group
    channels: dict[str, Floats] = field(default_factory=dict)
    drive_unit: str = "v"
    unit: str = "um"
    early: float = 0.0  # samples by which the drive is shifted to earlier times than recorded
    rows_early: int = 0  # the same, shifted in the recordings before anything else
    stepped: bool = False  # input of lags and modes: zero-order hold instead of linear
    missing: int = 0  # samples of the grid without a reading
    repeats: int = 0  # samples that repeat the previous reading of a gauge polled too fast
    frozen: int = 0  # samples of a gauge that is stuck or at its limit
    lone: int = 0  # readings that are far off both of their neighbours
    stalls: int = 0  # number of times the recorder stalled
    raw_index: Ints = field(default_factory=lambda: np.zeros(0, dtype=np.int64))  # -1: no row
    between: "Data | None" = None  # the drive's path on a finer grid, on which all operators run
    places: Ints = field(default_factory=lambda: np.zeros(0, dtype=np.int64))  # (N,) rows in that

    @property
    def n(self) -> int:
        """Number of samples."""
        return int(self.u.size)

    @property
    def u_min(self) -> float:
        """Lowest drive."""
        return float(self.u.min())

    @property
    def span(self) -> float:
        """Range of the drive."""
        return float(np.ptp(self.u))

    @property
    def period(self) -> float:
        """Shortest sampling period [s]."""
        return float(self.dt.min())

    @property
    def path(self) -> "Data":
        """The data on which operators run, (M,) samples of the drive: these samples, or a finer
        grid that includes the drive between them."""
        return self if self.between is None else self.between

    def sampled(self, x: Floats) -> Floats:
        """Return x (M, ...), given on the path, at the N samples."""
        return x if self.between is None else x[self.places]

    def uncounted_heads(self) -> Ints:
        """Return the rows of the heads of recordings whose heads do not count."""
        counted = np.unique(self.rec[self.heads & self.rows])
        return np.flatnonzero(self.heads & ~np.isin(self.rec, counted))

    @property
    def drive_key(self) -> str:
        """Key of the drive among the channels."""
        return f"u_{self.drive_unit}"


def select_recording(data: Data, i: int) -> Data:
    """Return recording i on its own, without the finer path between its samples."""
    here = data.rec == i
    own = {
        f.name: getattr(data, f.name)[here]
        for f in fields(Data)
        if isinstance(getattr(data, f.name), np.ndarray) and f.name != "places"
    }
    channels = {name: c[here] for name, c in data.channels.items()}
    own["rec"] = np.zeros(int(here.sum()), dtype=np.int64)
    return replace(data, names=(data.names[i],), channels=channels, between=None, **own)
