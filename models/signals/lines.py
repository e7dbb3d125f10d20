"""Lines of fixed frequency that stand out of a residual in every recording."""

import numpy as np

from dehyst.models.signals.joined import Bools, Data, Floats
from dehyst.models.signals.periodic import fundamental_hz

MAX_LINES = 4
ISOLATED = 4.0  # times the multiples beside it, that a line on a multiple of the drive must reach
ISOLATED_ORDER = 10
STANDS_OUT = 4.5  # amplitude over the rms of its neighbourhood; by chance once in 1e5 records


def find_lines(data: Data, residual: Floats, count: int = MAX_LINES) -> list[float]:
    """Frequencies of lines that stand out in every recording long enough to tell, strongest
    first."""
    work = residual.astype(float).copy()
    found: list[float] = []
    names = range(len(data.names))
    fundamentals = [
        fundamental_hz(data.u[data.rec == i], float(data.dt[data.rec == i][0])) for i in names
    ]
    for _ in range(count):
        longest = max(float(np.ptp(data.t[data.rec == i])) for i in names)
        step = 0.5 / longest
        top = 0.49 / float(data.dt.max())
        grid = np.arange(2.0 / longest, top, step)
        total = np.full(grid.size, np.inf)
        driven = np.full(grid.size, np.inf)
        harmonic = np.ones(grid.size, dtype=bool)
        for i in names:
            here = data.rec == i
            e = work[here]
            dt = float(data.dt[here][0])
            if e.size < 400:
                continue
            window = np.hanning(e.size)
            size = 4 * e.size
            spectrum: Floats = np.abs(np.fft.rfft((e - e.mean()) * window, size))
            f: Floats = np.fft.rfftfreq(size, dt).astype(np.float64)
            local = _local_rms(spectrum)
            ratio = spectrum / (local + 1e-300)
            total = np.minimum(total, np.interp(grid, f, ratio))
            own = np.abs(
                np.fft.rfft((drive := data.u[here]) * window - drive.mean() * window, size)
            )
            driven = np.minimum(
                driven, np.interp(grid, f, own / (_local_rms(own) + 1e-9 * own.max()))
            )
            first = fundamentals[i]
            harmonic &= _harmonics(grid, first, longest, f, spectrum) if first else False
        if not np.isfinite(total).any():
            return found
        # a line that the drive has in every recording is the drive's doing
        total[(driven > 0.5 * total) | harmonic] = 0.0
        for known in found:
            total[np.abs(grid - known) < 6 * step] = 0.0
        at = int(np.argmax(np.where(np.isfinite(total), total, 0)))
        if total[at] < STANDS_OUT:
            break
        f0 = _refine(data, work, float(grid[at]), step)
        found.append(f0)
        work = work - _line(data, work, f0)
    return found


def _harmonics(grid: Floats, first: float, longest: float, f: Floats, spectrum: Floats) -> Bools:
    """Where a frequency is a multiple of the drive's own: what the loop's shape leaves there is
    locked to the drive. A line of high order that towers over the multiples beside it is not."""
    order = np.round(grid / first)
    out = np.abs(grid - order * first) < min(1.0 / longest, 0.25 * first)
    for k in np.unique(order[out & (order >= ISOLATED_ORDER)]):
        near = np.interp(first * (k + np.r_[-4:5]), f, spectrum, right=0.0)
        if near[4] > ISOLATED * np.delete(near, 4).max():
            out[order == k] = False
    return out


def _local_rms(spectrum: Floats, half: int = 160, hole: int = 12) -> Floats:
    """Rms of the neighbours of each bin without the bin's own peak."""
    power = np.concatenate([spectrum[half:0:-1], spectrum, spectrum[-2 : -half - 2 : -1]]) ** 2
    c = np.r_[0.0, np.cumsum(power)]
    i = np.arange(spectrum.size) + half
    wide = c[i + half] - c[i - half]
    own = c[i + hole] - c[i - hole]
    return np.sqrt(np.maximum(wide - own, 0) / (2 * half - 2 * hole))


def _line(data: Data, x: Floats, f: float) -> Floats:
    out = np.zeros_like(x)
    for i in range(len(data.names)):
        here = data.rec == i
        a = np.exp(-2j * np.pi * f * data.t[here])
        z = 2.0 * np.mean(a * (x[here] - x[here].mean()))
        out[here] = np.real(z * np.conj(a))
    return out


def _refine(data: Data, x: Floats, f0: float, step: float) -> float:
    grid = f0 + np.linspace(-1.5, 1.5, 31) * step
    power = [float(np.sum(_line(data, x, f) ** 2)) for f in grid]
    return float(grid[int(np.argmax(power))])
