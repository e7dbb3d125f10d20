"""Where the misfit is: its power by time, band, voltage, rate, turns, holds and channels.

Each table compares the power of the residual with what noise alone would put into the same bins:
share = (power - noise) / excess. Only tables; pictures are drawn elsewhere.
"""

from typing import Any

import numpy as np
from numba import njit

from dehyst.models.signals.joined import Bools, Data, Floats, Ints
from dehyst.models.units import spell_unit

SLOTS = 24  # of a recording in time, and of the spectrum: a few per cent each
LEVELS = 20  # of the drive's range, 5 % each
STILL = 1e-3  # of the drive's range per 100 samples: the drive rests below this rate
TURN = 2e-3  # of the drive's range: smaller reversals are noise of the drive, not turns
HELD = 2e-4  # of the drive's range, between two samples: within this the drive is held
FEWEST = 64  # samples of a part whose spectrum fills the bands
LOCALISED = 0.2  # of the excess: where all bins together hold less, it is not in this table
HOT = 0.15  # of the excess, which one bin must hold to be named,
DENSE = 2.0  # and this many times what its share of the rows would hold by chance
CORRELATED = 0.3  # correlation with a channel that is named: it explains a tenth of the power


def locate(data: Data, residual: Floats, sigma: float) -> dict[str, Any]:
    """Return tables by name: {"edges" or "labels", "power" (mean square), "share", "unit"}.

    power: mean square of the residual in the bin; share: share of the whole excess that the bin
    holds (0 where it is at the noise). `noise` is what a bin of pure noise would have.
    """
    e = residual
    out: dict[str, Any] = {"noise": sigma**2, "rows": int(data.rows.sum())}
    total = float(np.sum(e[data.rows] ** 2 - sigma**2))
    total = max(total, 1e-30)

    def table(values: Floats, edges: Floats, unit: str, mask: Bools | None = None) -> Any:
        used = data.rows if mask is None else data.rows & mask
        place = np.clip(np.digitize(values[used], edges[1:-1]), 0, edges.size - 2)
        count = np.bincount(place, minlength=edges.size - 1)
        power = np.bincount(place, e[used] ** 2, edges.size - 1)
        share = np.clip((power - count * sigma**2) / total, 0.0, 1.0)
        share[power < count * sigma**2 * (1 + 3 * np.sqrt(2.0 / np.maximum(count, 1)))] = 0.0
        return {
            "edges": edges.tolist(),
            "count": count.tolist(),
            "power": (power / np.maximum(count, 1)).tolist(),
            "share": share.tolist(),
            "unit": unit,
        }

    begins = np.array([data.t[data.rec == i][0] for i in range(len(data.names))])
    elapsed = data.t - begins[data.rec]
    out["time"] = {}
    for i, name in enumerate(data.names):
        here = data.rec == i
        edges = np.linspace(0, elapsed[here].max(), SLOTS + 1)
        out["time"][name] = table(elapsed, edges, "s", here)
    volts = spell_unit(data.drive_unit)
    out["drive"] = table(data.u, np.linspace(data.u.min(), data.u.max(), LEVELS + 1), volts)
    rate = np.diff(data.u, prepend=data.u[0]) / data.dt
    rate[data.starts] = 0.0
    smooth = np.convolve(rate, np.full(5, 0.2), "same")
    still = np.abs(smooth) < STILL * data.span / max(np.median(data.dt) * 100, 1e-9)
    out["direction"] = {
        "labels": ["falling", "resting", "rising"],
        "share": [
            _share(e, sigma, total, data.rows & m)
            for m in ((smooth < 0) & ~still, still, (smooth > 0) & ~still)
        ],
    }
    top = float(np.abs(rate).max())
    if top > 0:
        edges = np.r_[0.0, np.geomspace(1e-3 * top, top, 13)]
        out["rate"] = table(np.abs(rate), edges, f"{volts}/s")
    turn = seconds_since_turn(data)
    out["since_turn"] = table(turn, np.r_[0, np.geomspace(data.period, 10.0, 14)], "s")
    hold = time_in_hold(data)
    if np.any(hold > 0):
        out["in_hold"] = table(
            hold,
            np.geomspace(data.period, max(float(hold.max()), 2 * data.period), 13),
            "s",
            hold > 0,
        )
    out["band"] = _bands(data, e, sigma)
    out["channels"] = {
        name: _correlation(c, e, data) for name, c in {"drive": data.u, **data.channels}.items()
    }
    return out


def hot_spots(tables: dict[str, Any]) -> dict[str, str]:
    """Return where most of the excess is, in words: table -> the bin with an excess out of
    proportion."""
    out: dict[str, str] = {}
    for name in ("drive", "rate", "since_turn", "in_hold", "band"):
        t = tables.get(name)
        if not t:
            continue
        share, count = np.array(t["share"]), np.array(t["count"], dtype=float)
        whole = count.sum() if name == "band" else tables["rows"]
        part = count / max(whole, 1)
        if share.sum() < LOCALISED:
            continue
        density = share / np.maximum(part, 0.01)
        k = int(np.argmax(np.where(share > HOT, density, 0)))
        if share[k] > HOT and density[k] > DENSE:
            low, high = t["edges"][k], t["edges"][k + 1]
            out[name] = f"{share[k]:.0%} at {low:.3g} to {high:.3g} {t['unit']}"
    parts = [(n, k, s) for n, t in tables["time"].items() for k, s in enumerate(t["share"])]
    if parts:
        name, k, s = max(parts, key=lambda p: p[2])
        if s > HOT:
            edges = tables["time"][name]["edges"]
            out["time"] = f"{s:.0%} in {name} at {edges[k]:.3g} to {edges[k + 1]:.3g} s"
    strongest = max(tables["channels"].items(), key=lambda p: abs(p[1]), default=("", 0.0))
    if abs(strongest[1]) > CORRELATED:
        out["channel"] = f"correlation {strongest[1]:.2f} with {strongest[0]}"
    return out


def seconds_since_turn(data: Data) -> Floats:
    """Return (N,) seconds since the drive last reversed by more than 0.2 % of its range."""
    return data.t - data.t[_last_turn(data.u, data.starts, TURN * data.span)]


@njit(cache=True, nogil=True)
def _last_turn(u: Floats, starts: Bools, margin: float) -> Ints:
    """Return the index of the last extremum from which the drive has moved away by more than the
    margin."""
    out = np.zeros(u.size, dtype=np.int64)
    high = low = u[0]
    high_at = low_at = turn = 0
    direction = 0
    for t in range(u.size):
        if starts[t]:
            high = low = u[t]
            high_at = low_at = turn = t
            direction = 0
        if u[t] >= high:
            high, high_at = u[t], t
        if u[t] <= low:
            low, low_at = u[t], t
        if direction >= 0 and high - u[t] > margin:
            direction, turn = -1, high_at
            low, low_at = u[t], t
        elif direction <= 0 and u[t] - low > margin:
            direction, turn = 1, low_at
            high, high_at = u[t], t
        out[t] = turn
    return out


def time_in_hold(data: Data) -> Floats:
    """Return (N,) seconds that the drive has been at rest (within 0.02 % of its range); 0 while it
    moves."""
    move = np.abs(np.diff(data.u, prepend=data.u[0])) > HELD * data.span
    move |= data.starts
    last = np.maximum.accumulate(np.where(move, np.arange(data.n), 0))
    out = data.t - data.t[last]
    return np.where(out > 3 * data.dt, out, 0.0)


def _share(e: Floats, sigma: float, total: float, mask: Bools) -> float:
    return float(max(np.sum(e[mask] ** 2 - sigma**2), 0.0) / total)


def _bands(data: Data, e: Floats, sigma: float) -> dict[str, Any]:
    """Return the excess by frequency, in logarithmic bands of the spectra of each part."""
    top = 0.5 / data.period
    longest = max(float(np.ptp(data.t[data.rec == i])) for i in range(len(data.names)))
    edges = np.geomspace(max(2.0 / longest, 1e-4 * top), top, SLOTS + 1)
    power, count = np.zeros(SLOTS), np.zeros(SLOTS)
    for p in np.unique(data.part):
        here = data.part == p
        used = data.rows[here]
        if used.sum() < FEWEST:
            continue
        # rows that do not count weigh nothing and keep their time
        window = np.hanning(used.size) * used
        x = (e[here] - e[here][used].mean()) * window
        spectrum = np.abs(np.fft.rfft(x)) ** 2 / np.sum(window**2)
        f = np.fft.rfftfreq(used.size, float(data.dt[here][0]))
        place = np.digitize(f, edges) - 1
        good = (place >= 0) & (place < SLOTS)
        power += np.bincount(place[good], spectrum[good], SLOTS)
        count += np.bincount(place[good], minlength=SLOTS)
    over = np.clip(power - count * sigma**2, 0.0, None)
    return {
        "edges": edges.tolist(),
        "count": count.tolist(),
        "power": (power / np.maximum(count, 1)).tolist(),
        "share": (over / max(float(over.sum()), 1e-30)).tolist(),
        "unit": "Hz",
    }


def _correlation(c: Floats, e: Floats, data: Data) -> float:
    """Return the correlation of the residual with a channel, less the means of each recording."""
    xy = xx = yy = 0.0
    for i in range(len(data.names)):
        k = (data.rec == i) & data.rows
        a, b = c[k] - c[k].mean(), e[k] - e[k].mean()
        xy, xx, yy = xy + float(a @ b), xx + float(a @ a), yy + float(b @ b)
    return xy / np.sqrt(xx * yy) if xx > 0 and yy > 0 else 0.0
