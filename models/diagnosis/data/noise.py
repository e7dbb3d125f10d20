"""The noise floor of the displacement reading.

It is estimated from the upper part of the residual's spectrum, or from the residual's differences,
which remove everything smooth and leave white noise (D. Donoho's robust median rule on a
high-pass). Lines and ringing are rejected by medians over time and over frequency.
"""

import numpy as np

from dehyst.models.diagnosis.tuning import TUNING
from dehyst.models.signals.joined import Data, Floats
from dehyst.models.signals.periodic import period_samples
from dehyst.models.signals.rounding import quantum, rounding_rms


def noise_rms(data: Data, residual: Floats) -> float:
    """Return the rms of the white part of a residual (N,), in displacement units.

    Where the drive repeats itself exactly, what the reading does not repeat is noise too, and the
    smaller of the two estimates is used: a drive that fills the band leaves no quiet part of it.

    Usually the upper two thirds of the band of windowed segments are used: the median over time of
    each frequency, then the median over frequencies, so that fixed lines, ringing and moves do not
    count. Where rows are missing throughout, differences of adjacent valid samples replace the
    spectra; for a polled gauge, fourth differences of its readings. The result is never less than
    the quantisation noise of the reading: one step over the root of 12. A median magnitude times
    1.4826 is the standard deviation of normal noise.
    """
    powers = []
    window = np.hanning(TUNING.segment)
    norm = float((window**2).sum())
    for p in np.unique(data.part):
        e = residual[data.part == p]
        for a in range(0, e.size - TUNING.segment + 1, TUNING.segment // 2):
            x = e[a : a + TUNING.segment]
            slope = np.linspace(-0.5, 0.5, TUNING.segment)
            x = x - x.mean() - slope * (12.0 * float((x * slope).mean()))
            powers.append(np.abs(np.fft.rfft(x * window)) ** 2 / norm)
    floor = rounding_rms(quantum(data.y))
    if data.repeats:
        return max(floor, _fourth_differences(data, residual), 1e-12)
    if data.missing > TUNING.crumb * data.n:
        both = data.rows[1:] & data.rows[:-1] & ~data.starts[1:]
        d = np.diff(residual)[both]
        if d.size > TUNING.segment:
            return max(floor, float(1.4826 * np.median(np.abs(d)) / np.sqrt(2.0)), 1e-12)
    repeated = _unrepeated(data)
    if not powers:
        return max(floor, _fourth_differences(data, residual), 1e-12)
    spectra = np.array(powers)[:, 2 * TUNING.segment // 6 :]
    # exponential statistics: median = ln 2 times the mean
    by_line = np.median(spectra, axis=0) / np.log(2.0)
    return max(floor, min(float(np.sqrt(np.median(by_line))), repeated), 1e-12)


def _fourth_differences(data: Data, residual: Floats) -> float:
    """Return the noise rms from fourth differences of the counted rows of each part; 0 where every
    part is too short for one. For white noise their power is that of the noise times 70, the sum of
    squares of 1, 4, 6, 4, 1."""
    d = np.concatenate(
        [np.diff(residual[(data.part == p) & data.rows], 4) for p in np.unique(data.part)]
    )
    return float(1.4826 * np.median(np.abs(d)) / np.sqrt(70.0)) if d.size else 0.0


def _unrepeated(data: Data) -> float:
    """Return the rms of the difference between two periods of the drive, over the root of two;
    infinite where no recording repeats."""
    best = np.inf
    for p in np.unique(data.part):
        u, y = data.u[data.part == p], data.y[data.part == p]
        if u.size < 4 * TUNING.segment:  # too short for two periods and a median
            continue
        lag = period_samples(u)
        # 2e-3: the noise of the drive is smaller; a larger difference is another motion
        if lag == 0 or np.abs(u[lag:] - u[:-lag]).max() > 2e-3 * data.span:
            continue
        # differenced once more, because drift is not noise: four readings, four times the power
        d = np.diff(y[lag:] - y[:-lag])
        best = min(best, float(1.4826 * np.median(np.abs(d)) / 2.0))
    return best
