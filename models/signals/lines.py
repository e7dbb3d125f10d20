"""Find lines of fixed frequency that exceed the background of a residual in every recording.

Bins are excluded where the drive, or a hysteresis driven by it, has lines: the drive's frequencies,
their harmonics and intermodulation products, each as wide as the window's main lobe. An external
line in such a bin cannot be distinguished from the loop's shape.

Under feedback a line of the reading also appears in the drive. It counts as external if the
residual has it about as strong as the drive would make it, and the drive moves mainly at other
frequencies: no error of a loop is as large as the whole displacement.
"""

from dataclasses import dataclass
from functools import lru_cache

import numpy as np

from dehyst.models.signals.filters import dahl, plays
from dehyst.models.signals.joined import Bools, Data, Floats, Ints
from dehyst.models.signals.periodic import fundamental_hz

MAX_LINES = 4
PADDED = 4  # length of a zero-padded transform, relative to the samples
LOBE = 2  # half width of the main lobe of the Hann window [bins]
WIDTHS = np.array([0.03, 0.2])  # of the drive range: operators that make the drive's products
AS_STRONG = 0.5  # a product hides a line from this fraction of the line's relative height on
AS_HIGH = 0.7  # a line is external from this fraction of what the drive's line would cause on,
MINOR = 0.05  # if the drive's line is below this fraction of the drive's strongest line
BLIND = 1 / 3  # largest fraction of the frequencies that harmonics of the drive may exclude
NEAR = 0.05  # relative distance within which a line may be mistaken for a mode
MOST_STEPS = 801  # largest number of frequencies in a search grid
ALIKE = 1e-3  # largest relative difference of the drive's frequency between recordings
AROUND, OWN = 160, 12  # bins to either side: the neighbourhood of a bin, and its own peak
STANDS_OUT = 4.5  # amplitude over the rms of its neighbourhood; by chance once in 1e5 records


def find_lines(data: Data, residual: Floats, count: int = MAX_LINES) -> list[float]:
    """Return the frequencies [Hz] of lines that exceed the background in every sufficiently long
    recording, strongest first."""
    work = residual.astype(float).copy()
    found: list[float] = []
    slope = _slope(data)
    names = range(len(data.names))
    whole = [_longest_part(data, i) for i in names]
    longest = max(float(np.ptp(data.t[here])) for here in whole)
    drives = [_drive_of(data, here) for here in whole]
    for _ in range(count):
        step = 0.5 / longest  # Hz: half a bin
        top = 0.49 / float(data.dt.max())  # Hz: just below the Nyquist frequency
        grid = np.arange(2.0 / longest, top, step)  # two waves at least
        total = np.full(grid.size, np.inf)
        driven = np.full(grid.size, np.inf)
        fed_back = np.ones(grid.size, dtype=bool)
        harmonic = np.ones(grid.size, dtype=bool)
        for i in names:
            here = whole[i]
            e = work[here]
            dt = float(data.dt[here][0])
            if e.size < 400:  # samples: their bins are too few to have neighbours
                continue
            f, spectrum = _spectrum(e, dt)
            local = _local_rms(spectrum)
            ratio = spectrum / (local + 1e-300)
            total = np.minimum(total, np.interp(grid, f, ratio))
            drive = drives[i]
            driven = np.minimum(driven, np.interp(grid, f, drive.products))
            fed_back &= np.interp(grid, f, _as_high(spectrum, drive, slope)) > 0.5  # between 0, 1
            first = drive.first_hz
            own = drive.everywhere | (np.interp(grid, f, drive.products) > STANDS_OUT)
            harmonic &= _harmonics(grid, first, longest) & own if first else False
        if not np.isfinite(total).any():
            return found
        # a line that the drive has in every recording is caused by the drive
        total[(driven > AS_STRONG * total) & ~fed_back | harmonic] = 0.0
        for known in found:
            total[np.abs(grid - known) < 6 * step] = 0.0  # 3 bins: its main lobe
        at = int(np.argmax(np.where(np.isfinite(total), total, 0)))
        if total[at] < STANDS_OUT:
            break
        f0 = _refine(data, work, float(grid[at]), step)
        found.append(f0)
        work = work - _line(data, work, f0)
    return found


def gain_of_line(data: Data, residual: Floats, near_hz: float) -> float:
    """Return the decrease of the sum of squares by one line near a frequency, with a free phase in
    each recording."""
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


def is_drive_line(data: Data, residual: Floats, here: Bools, f: float) -> bool:
    """Return whether a hysteresis driven in a stretch `here` (N,) would have a line at f [Hz] about
    as far above its neighbours as the residual's line."""
    at, spectrum = _spectrum(residual[here], float(data.dt[here][0]))
    own = np.interp(f, at, spectrum / (_local_rms(spectrum) + 1e-300))
    return bool(np.interp(f, at, _drive_of(data, here).products) > AS_STRONG * own)


def drive_repetition_hz(data: Data) -> float:
    """Return the frequency [Hz] at which the drive of every recording repeats itself; 0 if one does
    not, or if the frequencies differ."""
    names = range(len(data.names))
    own = np.array([_drive_of(data, _longest_part(data, i)).first_hz for i in names])
    same = own.min() > 0 and np.ptp(own) < ALIKE * own.min()
    return float(own.mean()) if same else 0.0


def _longest_part(data: Data, i: int) -> Bools:
    """Return the longest stretch without a gap of a recording, as a mask (N,)."""
    parts, sizes = np.unique(data.part[data.rec == i], return_counts=True)
    return np.asarray(data.part == parts[np.argmax(sizes)])


def _spectrum(x: Floats, dt: float) -> tuple[Floats, Floats]:
    """Return frequencies [Hz] and amplitudes, with a Hann window."""
    size = PADDED * x.size
    amplitude = np.abs(np.fft.rfft((x - x.mean()) * np.hanning(x.size), size))
    return np.fft.rfftfreq(size, dt).astype(np.float64), amplitude.astype(np.float64)


def _slope(data: Data) -> float:
    """Return the mean displacement per unit of drive over all recordings."""
    u, y = data.u[data.rows], data.y[data.rows]
    u = u - u.mean()
    return abs(float(u @ (y - y.mean()))) / max(float(u @ u), 1e-300)


@dataclass(frozen=True)
class _DriveLines:
    """Lines of a recording's drive, independent of the reading. spectrum: of the drive; minor:
    where that has minor lines; products: relative height of the lines of a hysteresis; first_hz:
    the frequency at which the drive repeats (0: none); everywhere: exclude all its harmonics, not
    only those at which a hysteresis has lines."""

    spectrum: Floats
    minor: Bools
    products: Floats
    first_hz: float
    everywhere: bool


def _drive_of(data: Data, here: Bools) -> _DriveLines:
    u, forgets = data.u[here], data.forgets[here]
    dt = float(data.dt[here][0])
    return _drive_lines(u.tobytes(), forgets.tobytes(), data.u_min, data.span, dt)


@lru_cache(maxsize=16)  # called again for every residual of the same recordings
def _drive_lines(drive: bytes, forgotten: bytes, low: float, span: float, dt: float) -> _DriveLines:
    """Return the lines of the drive of one stretch. drive, forgotten: bytes of u, forgets (n,)."""
    u, forgets = np.frombuffer(drive), np.frombuffer(forgotten, dtype=np.int64)
    spectrum = np.abs(np.fft.rfft((u - u.mean()) * np.hanning(u.size), PADDED * u.size))
    minor = (spectrum < MINOR * spectrum.max()) & (spectrum > 3.0 * _local_rms(spectrum))  # a line
    products, first = _products(u, forgets, low, span, dt), fundamental_hz(u, dt)
    return _DriveLines(spectrum, minor, products, first, _everywhere(spectrum, first, u.size * dt))


def _everywhere(spectrum: Floats, first: float, seconds: float) -> bool:
    """Return whether a drive contains the frequency at which it repeats, or repeats often enough
    that other lines fall between the harmonics. A sum of sines repeats with a common period at
    which it has no content; harmonics of that frequency are close to every line."""
    bins = np.abs(np.arange(spectrum.size) - first * PADDED * seconds)
    moves = float(spectrum[bins < PADDED].max(initial=0.0)) > MINOR * float(spectrum.max())
    return moves or BLIND * first * seconds > 2.0 * (LOBE + 0.5)


def _as_high(spectrum: Floats, drive: _DriveLines, slope: float) -> Floats:
    """Return 1 in the bins where a residual's line is about as high as the drive's line would make
    it and the drive's line is minor, 0 elsewhere."""
    high = spectrum > AS_HIGH * slope * drive.spectrum
    return np.asarray(drive.minor & high, dtype=np.float64)


def _products(u: Floats, forgets: Ints, low: float, span: float, dt: float) -> Floats:
    """Return the height over their neighbours of the lines of a hysteresis with a recording's
    drive, by frequency; each is as wide as the main lobe."""
    from scipy.ndimage import maximum_filter1d  # a slow import that the loop does not need

    x = 2.0 * (u - low) / span - 1.0
    h, z = plays(2.0 * WIDTHS, x + 1.0, forgets) - 1.0, dahl(2.0 * WIDTHS, x, forgets)
    columns = [x, x**2, x**3, *h.T, *(h**2).T, *(h**3).T, *z.T, *(z**2).T, *(z**3).T]
    top = np.zeros(0)
    for column in columns:
        _, own = _spectrum(column, dt)
        # relative to the column's background: leakage and rounding
        ratio = own / (_local_rms(own) + 1e-9 * own.max() + 1e-300)
        top = ratio if top.size == 0 else np.maximum(top, ratio)
    return np.asarray(maximum_filter1d(top, 2 * LOBE * PADDED + 1))


def _harmonics(grid: Floats, first: float, longest: float) -> Bools:
    """Return where a frequency is a multiple of the drive's: errors of the loop's shape are there,
    locked to the drive."""
    order = np.round(grid / first)
    return np.abs(grid - order * first) < min((LOBE + 0.5) / longest, 0.45 * first)  # 0.5: all


def _local_rms(spectrum: Floats) -> Floats:
    """Return the rms of the neighbours of each bin, excluding the bin's own peak."""
    half, hole = AROUND, OWN
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
    """Return the frequency near f0 whose line has the most power; the grid is finer if a
    recording's stretches are far apart."""
    apart = float(np.ptp(data.t)) * 2.0 * step  # total length relative to that of a stretch
    count = int(np.clip(2 * round(15 * apart) + 1, 31, MOST_STEPS))  # 20 a bin of the whole
    grid = f0 + np.linspace(-1.5, 1.5, count) * step
    power = [float(np.sum(_line(data, x, f) ** 2)) for f in grid]
    return float(grid[int(np.argmax(power))])
