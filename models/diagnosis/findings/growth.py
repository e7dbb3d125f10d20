"""Find when an effect grows, or fades, within a recording: two amplitudes in place of one, and the
time between them.

With x the effect's contribution and r the residual without it, both projected off everything else
that is fitted, the amplitude over some samples is <x, r> / <x, x>. Where an effect imitates an
error of the base, its amplitudes scatter from stretch to stretch; an effect that begins, or grows,
has two.
"""

from dataclasses import dataclass

import numpy as np

from dehyst.models.signals.joined import Data, Floats

STRETCHES = 24  # of each recording, each with 4 % of its rows
LEAST = 0.08  # of the recording's contribution, on either side of the time, at least
SCATTER = 0.1  # of the contribution's power, by which a second amplitude must improve the fit
TAKEN = 0.7  # of the scatter between stretches, which two amplitudes must remove
LOW = 0.5  # of the larger amplitude, which the smaller one must stay below
ABSENT = 0.2  # of it: below, the effect is absent
PRICE = 25.0  # in noise variances, of the time and the second amplitude


@dataclass(frozen=True)
class Growth:
    """Amplitudes before and after a time of a recording."""

    recording: str
    at_s: float
    before: float
    behind: float

    @property
    def says(self) -> str:
        """The change in words."""
        grows = abs(self.behind) > abs(self.before)
        low, high = sorted((abs(self.before), abs(self.behind)))
        place = f"{self.at_s:.3g} s of {self.recording}"
        if low < ABSENT * high:
            return f"It is present {'from' if grows else 'until'} {place}."
        times = self.behind / self.before
        return f"It {'grows' if grows else 'falls'} at {place}, to {times:.2g} times its size."

    @property
    def where(self) -> dict[str, float | str]:
        """The place: the time from which, or until which, it is present, or larger."""
        key = "from_s" if abs(self.behind) > abs(self.before) else "until_s"
        return {"recording": self.recording, key: self.at_s}


def growth(data: Data, sigma: float, x: Floats, r: Floats) -> Growth | None:
    """Return the clearest change of an effect's amplitude within a recording; None where it has one
    amplitude, or many. x (N,): its contribution; r (N,): the residual without it."""
    found = []
    for i, name in enumerate(data.names):
        at = np.flatnonzero((data.rec == i) & data.rows)
        if at.size < 10 * STRETCHES:  # rows: too few to a stretch
            continue
        xx, xr = np.cumsum(x[at] ** 2), np.cumsum(x[at] * r[at])
        total = float(xx[-1])
        if total <= 0.0:
            continue
        k = np.arange(1, at.size)
        k = k[(xx[k - 1] > LEAST * total) & (xx[k - 1] < (1.0 - LEAST) * total)]
        if not k.size:
            continue
        low, high = xx[k - 1], total - xx[k - 1]
        gains = xr[k - 1] ** 2 / low + (xr[-1] - xr[k - 1]) ** 2 / high - xr[-1] ** 2 / total
        best = int(np.argmax(gains))
        split, gain = int(k[best]), float(gains[best])
        before = float(xr[split - 1] / low[best])
        behind = float((xr[-1] - xr[split - 1]) / high[best])
        scatter = _scatter(x[at], r[at], sigma)
        smaller, larger = sorted((before, behind), key=abs)
        clear = gain > max(PRICE * sigma**2, TAKEN * scatter, SCATTER * total)
        if clear and -ABSENT < smaller / larger < LOW:
            found.append((gain, Growth(name, float(data.t[at[split]]), before, behind)))
    return max(found, key=lambda one: one[0])[1] if found else None


def _scatter(x: Floats, r: Floats, sigma: float) -> float:
    """Return the sum of squares by which the amplitudes of stretches differ from a common one,
    beyond the noise."""
    pieces = [
        (float(a @ a), float(a @ b))
        for a, b in zip(np.array_split(x, STRETCHES), np.array_split(r, STRETCHES), strict=True)
    ]
    xx, xr = (np.array(one) for one in zip(*pieces, strict=True))
    mean = float(xr.sum() / xx.sum())
    heavy = xx > 0.0
    deviation = float(np.sum((xr[heavy] / xx[heavy] - mean) ** 2 * xx[heavy]))
    return max(deviation - sigma**2 * (int(heavy.sum()) - 1), 0.0)
