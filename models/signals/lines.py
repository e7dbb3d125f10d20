"""Lines of fixed frequency that stand out of a residual in every recording.

Blind are the bins where the drive or what a hysteresis makes of it has lines: its own frequencies,
their harmonics and intermodulation products, each as wide as the window's main lobe. A line of the
surroundings that falls there cannot be distinguished from the loop's shape.

Under feedback a line of the reading stands in the drive too. It is one of the surroundings where
the residual has it about as strong as the drive would make it, while the drive moves by other
frequencies: no loop is wrong by as much as it is high.
"""

from dataclasses import dataclass
from functools import lru_cache

import numpy as np

from dehyst.models.signals.filters import dahl, plays
from dehyst.models.signals.joined import Bools, Data, Floats, Ints
from dehyst.models.signals.periodic import fundamental_hz

MAX_LINES = 4
PADDED = 4  # times the samples, in a transform
LOBE = 2  # bins to either side, that the main lobe of the window (Hann) reaches
WIDTHS = np.array([0.03, 0.2])  # of the drive's range: of the plays and memories that make products
AS_STRONG = 0.5  # of a line's height over its neighbours, that a product's must reach to hide it
AS_HIGH = 0.7  # of what the drive's line would make, that a residual's must reach to be no product,
MINOR = 0.05  # where the drive's line is no more than this part of its strongest
BLIND = 1 / 3  # of the frequencies, that the harmonics of the whole may take
NEAR = 0.05  # of a mode's frequency, within which a line may stand for it
MOST_STEPS = 801  # of frequency
ALIKE = 1e-3  # part of a frequency, by which those of several recordings may differ
STANDS_OUT = 4.5  # amplitude over the rms of its neighbourhood; by chance once in 1e5 records


def find_lines(data: Data, residual: Floats, count: int = MAX_LINES) -> list[float]:
    """Frequencies of lines that stand out in every recording long enough to tell, strongest
    first."""
    work = residual.astype(float).copy()
    found: list[float] = []
    slope = _slope(data)
    names = range(len(data.names))
    whole = [_longest_part(data, i) for i in names]
    longest = max(float(np.ptp(data.t[here])) for here in whole)
    drives = [_drive_of(data, here) for here in whole]
    for _ in range(count):
        step = 0.5 / longest
        top = 0.49 / float(data.dt.max())
        grid = np.arange(2.0 / longest, top, step)
        total = np.full(grid.size, np.inf)
        driven = np.full(grid.size, np.inf)
        fed_back = np.ones(grid.size, dtype=bool)
        harmonic = np.ones(grid.size, dtype=bool)
        for i in names:
            here = whole[i]
            e = work[here]
            dt = float(data.dt[here][0])
            if e.size < 400:
                continue
            f, spectrum = _spectrum(e, dt)
            local = _local_rms(spectrum)
            ratio = spectrum / (local + 1e-300)
            total = np.minimum(total, np.interp(grid, f, ratio))
            drive = drives[i]
            driven = np.minimum(driven, np.interp(grid, f, drive.products))
            fed_back &= np.interp(grid, f, _as_high(spectrum, drive, slope)) > 0.5
            first = drive.first_hz
            own = drive.everywhere | (np.interp(grid, f, drive.products) > STANDS_OUT)
            harmonic &= _harmonics(grid, first, longest) & own if first else False
        if not np.isfinite(total).any():
            return found
        # a line that the drive has in every recording is the drive's doing
        total[(driven > AS_STRONG * total) & ~fed_back | harmonic] = 0.0
        for known in found:
            total[np.abs(grid - known) < 6 * step] = 0.0
        at = int(np.argmax(np.where(np.isfinite(total), total, 0)))
        if total[at] < STANDS_OUT:
            break
        f0 = _refine(data, work, float(grid[at]), step)
        found.append(f0)
        work = work - _line(data, work, f0)
    return found


def gain_of_line(data: Data, residual: Floats, near_hz: float) -> float:
    """Fall of the sum of squares by one line near a frequency, of any phase in each recording."""
    grid = near_hz * np.linspace(1.0 - NEAR, 1.0 + NEAR, MOST_STEPS)
    gain = np.zeros(grid.size)
    for i in range(len(data.names)):
        here = data.rec == i
        counted = data.rows[here]
        e = np.where(counted, residual[here] - residual[here][counted].mean(), 0.0)
        size = PADDED * e.size
        power = 2.0 * np.abs(np.fft.rfft(e, size)) ** 2 / max(int(counted.sum()), 1)
        gain += np.interp(grid, np.fft.rfftfreq(size, float(data.dt[here][0])), power)
    return float(gain.max())


def is_of_the_drive(data: Data, residual: Floats, here: Bools, f: float) -> bool:
    """Whether a hysteresis would make a line at f [Hz] of the drive in a stretch (N,), about as far
    above its neighbours as the residual's."""
    at, spectrum = _spectrum(residual[here], float(data.dt[here][0]))
    own = np.interp(f, at, spectrum / (_local_rms(spectrum) + 1e-300))
    return bool(np.interp(f, at, _drive_of(data, here).products) > AS_STRONG * own)


def drive_repeats_hz(data: Data) -> float:
    """Frequency at which the drive of every recording repeats itself; 0 where one does not, or
    at another one."""
    names = range(len(data.names))
    own = np.array([_drive_of(data, _longest_part(data, i)).first_hz for i in names])
    same = own.min() > 0 and np.ptp(own) < ALIKE * own.min()
    return float(own.mean()) if same else 0.0


def _longest_part(data: Data, i: int) -> Bools:
    """(N,) the longest stretch of a recording without a gap."""
    parts, sizes = np.unique(data.part[data.rec == i], return_counts=True)
    return np.asarray(data.part == parts[np.argmax(sizes)])


def _spectrum(x: Floats, dt: float) -> tuple[Floats, Floats]:
    """Frequencies [Hz] and amplitudes, through a window of Hann."""
    size = PADDED * x.size
    amplitude = np.abs(np.fft.rfft((x - x.mean()) * np.hanning(x.size), size))
    return np.fft.rfftfreq(size, dt).astype(np.float64), amplitude.astype(np.float64)


def _slope(data: Data) -> float:
    """Displacement for a unit of drive, over all recordings."""
    u, y = data.u[data.rows], data.y[data.rows]
    u = u - u.mean()
    return abs(float(u @ (y - y.mean()))) / max(float(u @ u), 1e-300)


@dataclass(frozen=True)
class _DriveLines:
    """What the lines of a recording's drive are, whatever was read: its own spectrum, where that
    has minor lines, height of what a hysteresis makes of it, frequency of the whole (0: none), and
    whether all its harmonics are blind, or those that a hysteresis makes."""

    spectrum: Floats
    minor: Bools
    products: Floats
    first_hz: float
    everywhere: bool


def _drive_of(data: Data, here: Bools) -> _DriveLines:
    u, forgets = data.u[here], data.forgets[here]
    dt = float(data.dt[here][0])
    return _drive_lines(u.tobytes(), forgets.tobytes(), data.u_min, data.span, dt)


@lru_cache(maxsize=16)  # it is asked again for every residual of the same recordings
def _drive_lines(drive: bytes, forgotten: bytes, low: float, span: float, dt: float) -> _DriveLines:
    """drive, forgotten: u and forgets (n,) of one stretch."""
    u, forgets = np.frombuffer(drive), np.frombuffer(forgotten, dtype=np.int64)
    spectrum = np.abs(np.fft.rfft((u - u.mean()) * np.hanning(u.size), PADDED * u.size))
    minor = (spectrum < MINOR * spectrum.max()) & (spectrum > 3.0 * _local_rms(spectrum))
    products, first = _products(u, forgets, low, span, dt), fundamental_hz(u, dt)
    return _DriveLines(spectrum, minor, products, first, _everywhere(spectrum, first, u.size * dt))


def _everywhere(spectrum: Floats, first: float, seconds: float) -> bool:
    """Whether a drive moves at the frequency of the whole too, or repeats so often that lines fall
    between the harmonics. A sum of sines repeats with a common period at which it does not move:
    harmonics of that lie close to every line."""
    bins = np.abs(np.arange(spectrum.size) - first * PADDED * seconds)
    moves = float(spectrum[bins < PADDED].max(initial=0.0)) > MINOR * float(spectrum.max())
    return moves or BLIND * first * seconds > 2.0 * (LOBE + 0.5)


def _as_high(spectrum: Floats, drive: _DriveLines, slope: float) -> Floats:
    """1 in the bins where a residual's line is about as high as the drive's own would make it, and
    the drive's is a minor one; 0 elsewhere."""
    high = spectrum > AS_HIGH * slope * drive.spectrum
    return np.asarray(drive.minor & high, dtype=np.float64)


def _products(u: Floats, forgets: Ints, low: float, span: float, dt: float) -> Floats:
    """Height over their neighbours of the lines that a hysteresis makes of a recording's drive, by
    frequency; each as wide as the main lobe."""
    from scipy.ndimage import maximum_filter1d  # takes its time, and the loop does not need it

    x = 2.0 * (u - low) / span - 1.0
    h, z = plays(2.0 * WIDTHS, x + 1.0, forgets) - 1.0, dahl(2.0 * WIDTHS, x, forgets)
    columns = [x, x**2, x**3, *h.T, *(h**2).T, *(h**3).T, *z.T, *(z**2).T, *(z**3).T]
    top = np.zeros(0)
    for column in columns:
        _, own = _spectrum(column, dt)
        # by what the column does without a line: its own leakage, and rounding
        ratio = own / (_local_rms(own) + 1e-9 * own.max() + 1e-300)
        top = ratio if top.size == 0 else np.maximum(top, ratio)
    return np.asarray(maximum_filter1d(top, 2 * LOBE * PADDED + 1))


def _harmonics(grid: Floats, first: float, longest: float) -> Bools:
    """Where a frequency is a multiple of the drive's own: what the loop's shape leaves there is
    locked to the drive."""
    order = np.round(grid / first)
    return np.abs(grid - order * first) < min((LOBE + 0.5) / longest, 0.45 * first)


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
    """The frequency near f0 that takes most; finely where a recording's stretches lie far apart."""
    apart = float(np.ptp(data.t)) * 2.0 * step  # length of all in that of a stretch
    count = int(np.clip(2 * round(15 * apart) + 1, 31, MOST_STEPS))
    grid = f0 + np.linspace(-1.5, 1.5, count) * step
    power = [float(np.sum(_line(data, x, f) ** 2)) for f in grid]
    return float(grid[int(np.argmax(power))])
