"""Find the frequencies at which a residual rings."""

import numpy as np

from dehyst.models.signals.joined import Data, Floats

MOST = 2  # peaks that are tried as modes


def peaks(data: Data, residual: Floats) -> list[float]:
    """Return the frequencies [Hz] of the MOST highest peaks of the smoothed spectra of the
    residual's stretches."""
    best: list[tuple[float, float]] = []
    for p in np.unique(data.part):
        e = residual[data.part == p]
        if e.size < 512:  # samples: fewer than the bins need
            continue
        spectrum = np.abs(np.fft.rfft((e - e.mean()) * np.hanning(e.size))) ** 2
        group = max(1, spectrum.size // 256)  # about 256 bins: their noise is averaged
        m = spectrum.size // group
        smooth = spectrum[: m * group].reshape(m, group).mean(axis=1)
        f = (np.arange(m) + 0.5) * group / (e.size * float(data.dt[data.part == p][0]))
        inner = np.arange(3, m - 2)  # neither drift nor the last bins
        top = inner[(smooth[inner] >= smooth[inner - 1]) & (smooth[inner] >= smooth[inner + 1])]
        best += [(float(smooth[i]), float(f[i])) for i in top]
    best.sort(reverse=True)
    out: list[float] = []
    for _, f in best:
        if all(abs(np.log(f / g)) > 0.15 for g in out):  # nearer ones are one peak
            out.append(f)
        if len(out) == MOST:
            break
    return out
