"""Mains hum and any fixed line: sines of fixed frequency that do not know the drive."""

from collections.abc import Mapping, Sequence

import numpy as np

from dehyst.models.diagnosis.candidates.interface import Candidate, Context, Parameter, Probe, small
from dehyst.models.diagnosis.data import Bools, Data, Floats
from dehyst.models.diagnosis.periodic import fundamental_hz
from dehyst.models.model import Block

MAX_LINES = 4
ISOLATED = 4.0  # times the multiples beside it, that a line on a multiple of the drive must reach
ISOLATED_ORDER = 10
STANDS_OUT = 4.5  # amplitude over the rms of its neighbourhood; by chance once in 1e5 records


class Hum(Candidate):
    """sum_k A_k sin(2 pi f_k t + phase_k), phases free in each recording."""

    name = key = "hum"
    title = "Fixed lines"
    equation = "y(t) = f(u) + sum_k A_k sin(2 pi f_k t + phase_k)"
    source = "mains and its harmonics, switching supplies, fans and pumps"
    typical = "20 to 100 nm at 50 or 60 Hz"
    revealed_by = "rest, or a long hold"
    confused_with = ("resonance",)
    order = 70
    driven = False

    def params_at(self, theta: Sequence[float]) -> tuple[Parameter, ...]:
        return tuple(
            Parameter(f"frequency_{k + 1}_hz" if k else "frequency_hz", "Hz", f - w, f + w, False)
            for k, (f, w) in enumerate((round(v, 1), self._width) for v in theta)
        )

    def __init__(self, data: Data) -> None:
        self.limit_unit = data.unit
        lengths = [float(np.ptp(data.t[data.rec == i])) for i in range(len(data.names))]
        self._width = max(0.3, 1.0 / max(lengths))
        self._recordings = len(data.names)

    def starts(self, data: Data, residual: Floats) -> list[tuple[float, ...]]:
        lines = find_lines(data, residual)
        return [tuple(lines)] if lines else []

    def columns(self, data: Data, context: Context, theta: Sequence[float]) -> Floats:
        out = np.zeros((data.n, 2 * len(theta) * self._recordings))
        j = 0
        for f in theta:
            phase = 2 * np.pi * f * data.t
            sine, cosine = np.sin(phase), np.cos(phase)
            for i in range(self._recordings):
                here = data.rec == i
                out[here, j] = sine[here]
                out[here, j + 1] = cosine[here]
                j += 2
        return out

    def per_recording(self, theta: Sequence[float], amplitudes: Floats) -> Floats:
        """(lines, recordings) complex amplitudes; sin part real, cos part imaginary."""
        a = np.asarray(amplitudes).reshape(len(theta), self._recordings, 2)
        return a[..., 0] + 1j * a[..., 1]

    def values(self, theta: Sequence[float], amplitudes: Floats) -> dict[str, tuple[float, str]]:
        lines = self.per_recording(theta, amplitudes)
        out: dict[str, tuple[float, str]] = {}
        for k, f in enumerate(theta):
            tail = f"_{k + 1}" if k else ""
            out[f"frequency{tail}_hz"] = (float(f), "Hz")
            out[f"amplitude{tail}_um"] = (
                float(np.sqrt(np.mean(np.abs(lines[k]) ** 2))),
                self.limit_unit,
            )
        return out

    def probes(self, data: Data) -> list[Probe]:
        f = 50.0 if data.period < 0.005 else 0.1 / data.period
        return [Probe(1.0, (f,), (1.0, 0.0) * self._recordings)]

    def blocks(self, theta: Sequence[float], amplitudes: Floats, data: Data) -> tuple[Block, ...]:
        out = []
        for f, line in zip(theta, self.per_recording(theta, amplitudes), strict=True):
            mean = complex(line.mean())
            # with phases that differ between recordings nothing can be foretold: amplitude of
            # the mean phasor, which is then small
            out.append(
                Block(
                    "hum",
                    "sensor",
                    {
                        "frequency_hz": float(f),
                        f"amplitude_{data.unit}": abs(mean),
                        "phase_rad": float(np.angle(mean)),
                    },
                )
            )
        return tuple(out)

    def says(self, values: Mapping[str, tuple[float, str]]) -> str:
        f = [v for k, (v, _) in values.items() if k.startswith("frequency")]
        a = [small(v) for k, v in values.items() if k.startswith("amplitude")]
        lines = ", ".join(f"{y} at {x:.4g} Hz" for x, y in zip(f, a, strict=True))
        mains = any(abs(x / m - round(x / m)) < 0.004 and x > 40 for x in f for m in (50.0, 60.0))
        source = "the mains: check shielding and earth" if mains else "something that runs nearby"
        return f"The reading carries {lines}, whatever the drive does; look for {source}."


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


def candidates(data: Data) -> list[Candidate]:
    return [Hum(data)]
