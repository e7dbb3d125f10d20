"""What a rich base cannot absorb: the judge's own measure of whether an effect can be found at all.

The base: 40 plays of the recorded drive with their squares and cubes (which a Preisach stage
needs), an offset for each recording, and one lag of the stage's own displacement, with the time
constant that absorbs most (none if the effect is itself a lag or a delay). The size of an effect is
the residual of the difference that it makes. Shares no code with the library.
"""

from collections.abc import Sequence

import numpy as np
from numba import njit
from tests.rigs.plants.drives import Floats
from tests.rigs.plants.effects import delayed, low_pass

RIDGE = 1e-8
LAGS = np.geomspace(0.2, 40.0, 10)  # in the recorder's periods
TIE = 0.25  # of the noise or the class misfit: a rival with a smaller residual is as good a name
LATE = ("lag", "delay")


@njit(cache=True, nogil=True)
def _dead_bands(u: Floats, halves: Floats) -> Floats:
    out = np.empty((u.size, halves.size))
    p = np.full(halves.size, u[0])
    for t in range(u.size):
        for i in range(halves.size):
            p[i] = max(u[t] - halves[i], min(u[t] + halves[i], p[i]))
            out[t, i] = p[i]
    return out


class RichBase:
    """Residuals after the base above, over recordings laid end to end.

    drives: recorded drives, each (N_i,) in 0 to 10 V; dt: their period [s]; powers: of the plays.
    """

    def __init__(
        self, drives: Sequence[Floats], dt: float, powers: tuple[int, ...] = (1, 2, 3)
    ) -> None:
        self.sizes, self.dt = [u.size for u in drives], dt
        halves = np.r_[0.0, np.exp(np.linspace(np.log(0.02), np.log(5.0), 39))]
        blocks = []
        for i, u in enumerate(drives):
            plays = _dead_bands(u, halves) / 5.0
            offsets = np.zeros((u.size, len(drives)))
            offsets[:, i] = 1.0
            blocks.append(np.hstack([*(plays**p for p in powers), offsets]))
        self._columns = np.vstack(blocks)
        gram = self._columns.T @ self._columns
        gram[np.diag_indices_from(gram)] *= 1.0 + RIDGE
        self._factor = np.linalg.cholesky(gram)

    def residual(self, x: Floats) -> Floats:
        """Return (N,) or (N, k) without what the base can represent."""
        w = np.linalg.solve(self._factor.T, np.linalg.solve(self._factor, self._columns.T @ x))
        return np.asarray(x - self._columns @ w)

    def lags_of(self, y: Floats) -> list[Floats]:
        """Return what one lag removes from a displacement (N,), for every time constant."""
        return [self.residual(self._each(low_pass, y, k)) for k in LAGS]

    def delays_of(self, y: Floats) -> list[Floats]:
        """Return the same for a delay."""
        return [self.residual(self._each(delayed, y, k)) for k in LAGS]

    def trends(self) -> list[Floats]:
        """Return settling curves, with a separate size in each recording: (N, recordings) for each
        of some time constants; a straight line belongs to each."""
        out = []
        for late in np.geomspace(0.03, 3.0, 8):
            x = np.zeros((sum(self.sizes), 2 * len(self.sizes)))
            at = 0
            for i, n in enumerate(self.sizes):
                part = np.arange(n) / n
                x[at : at + n, 2 * i] = np.exp(-part / late)
                x[at : at + n, 2 * i + 1] = part
                at += n
            out.append(self.residual(x))
        return out

    def _each(self, change: object, y: Floats, k: float) -> Floats:
        at, out = 0, np.empty(y.size)
        for n in self.sizes:
            part = y[at : at + n]
            out[at : at + n] = change(part, k * self.dt, self.dt) - part  # type: ignore[operator]
            at += n
        return out


def rms(x: Floats) -> float:
    return float(np.sqrt(np.mean(x**2)))


def least_left(d: Floats, columns: Sequence[Floats]) -> float:
    """Return the rms of d after removing the best of the columns, (N,) or (N, k) each."""
    best = rms(d)
    for x in columns:
        x = x.reshape(d.size, -1)
        w = np.linalg.lstsq(x.T @ x + 1e-12 * np.eye(x.shape[1]), x.T @ d, rcond=None)[0]
        best = min(best, rms(d - x @ w))
    return best


class Size:
    """Sizes of effects on one stage: bare (N,) is its displacement without any.

    Effects that bend the loop are measured against plays alone, because a rich base is meant to
    absorb them.
    """

    def __init__(self, drives: Sequence[Floats], dt: float, bare: Floats) -> None:
        self.base, self.plays = RichBase(drives, dt), RichBase(drives, dt, (1,))
        base = self.base
        self._lags = base.lags_of(bare)
        self._bare = bare

    def left(self, name: str, difference: Floats) -> float:
        """Return the rms that the base leaves of an effect's difference (N,)."""
        if name == "shape":
            return rms(self.plays.residual(difference))
        rest = self.base.residual(difference)
        return rms(rest) if name in LATE else least_left(rest, self._lags)

    def ties(self, name: str, difference: Floats, noise: float) -> list[str]:
        """Return the names that would do as well: their residual is small against the noise."""
        rest = self.base.residual(difference)
        rivals = {"lag": self._lags, "drift": self.base.trends()} if name != "drift" else {}
        if name == "lag":
            rivals["delay"] = self.base.delays_of(self._bare)
        return [
            rival
            for rival, columns in rivals.items()
            if rival != name and least_left(rest, columns) < TIE * noise
        ]
