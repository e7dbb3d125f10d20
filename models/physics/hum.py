"""Fixed lines: y = x + sum_i A_i sin(2 pi f_i t + phase_i), t the time within the recording.

These are the mains, its harmonics, and any line whose frequency is independent of the drive. The
phase belongs to one recording. The block is therefore forward only, and is written only if several
recordings share the phase.
"""

import math
from collections.abc import Mapping, Sequence

import numpy as np

from dehyst.models.model import Block
from dehyst.models.physics.address import Kernel, numbers
from dehyst.models.physics.candidate import Candidate, Context, Parameter, Probe, format_length
from dehyst.models.physics.entry import Physics, Scales, Specimen
from dehyst.models.physics.kind import Kind, Never, Param, Values
from dehyst.models.signals.joined import Data, Floats
from dehyst.models.signals.lines import drive_repetition_hz, find_lines


@Kernel
def step(
    p_at: int, n_p: int, s_at: int, n_s: int, x: float, t: float, dt: float, ch: float
) -> float:
    """Forward. Parameters: triples of frequency, amplitude and phase."""
    p, y = numbers(p_at, n_p), x
    for i in range(0, n_p, 3):
        y += p[i + 1] * math.sin(2.0 * math.pi * p[i] * t + p[i + 2])
    return y


def _pack(values: Values, dt: float) -> Floats:
    return np.stack([values[n] for n in ("frequency", "amplitude", "phase")], axis=1).ravel()


def _check(values: Values) -> str:
    sizes = {values[n].size for n in ("frequency", "amplitude", "phase")}
    return "" if len(sizes) == 1 else "frequency_hz, amplitude and phase_rad: lists of one length"


ALIKE = 0.995
"""Recordings share a phase (within about 6 degrees) if the length of their mean phasor is at least
this fraction of their rms amplitude. Otherwise the line predicts nothing for a further recording,
and is not written. Two phases at random are as close as this once in 16 times, three once in some
300; a phase is measured to a few degrees, a shared one varies no more."""

KIND = Kind(
    name="hum",
    says="hum at fixed frequencies",
    places=("stage", "sensor"),
    params=(
        Param("frequency_hz", "frequency", "Hz", 0.0, 1e6, "frequencies", many=True),
        Param("amplitude_{y}", "amplitude", "", -1e9, 1e9, "amplitudes", many=True),
        Param("phase_rad", "phase", "rad", -1e3, 1e3, "phases", many=True),
    ),
    step=step,
    pack=_pack,
    inverse=Never("the phase belongs to one recording", of_one_recording=True),
    check=_check,
)


CLOCK = 1e-5
"""Relative error of a recorder's clock: quartz is good to some 10 ppm, and time stamps are all that
a frequency is measured by."""


class Hum(Candidate):
    """sum_k A_k sin(2 pi f_k t + phase_k), with separate amplitudes and phases per recording.
    Typical: 20 to 100 nm at 50 or 60 Hz; shown by rest, or a long hold."""

    name = key = "hum"
    title = "Fixed lines"
    equation = "y(t) = f(u) + sum_k A_k sin(2 pi f_k t + phase_k)"
    source = "mains and its harmonics, switching supplies, fans and pumps"
    confused_with = ("resonance",)
    order = 70
    driven = False
    place = "sensor"
    widest_spread = 0.6  # a line that is present only at times is reported with these times

    def params_at(self, theta: Sequence[float]) -> tuple[Parameter, ...]:
        return tuple(
            Parameter(
                f"frequency_{k + 1}_hz" if k else "frequency_hz", "Hz", f - w, f + w, False, CLOCK
            )
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
        """Return (lines, recordings) complex amplitudes; real: sine part, imaginary: cosine."""
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

    def limit_caveat(self, data: Data) -> str:
        f = drive_repetition_hz(data)
        return f"not on multiples of {f:.4g} Hz, at which the drive repeats itself" if f else ""

    def blocks(self, theta: Sequence[float], amplitudes: Floats, data: Data) -> tuple[Block, ...]:
        if self._recordings < 2:  # one recording does not show that the next has the same phase
            return ()
        out = []
        rows = np.bincount(data.rec[data.rows], minlength=self._recordings)
        for f, line in zip(theta, self.per_recording(theta, amplitudes), strict=True):
            counted = np.where(line != 0.0, rows, 0)  # amplitude 0: the recording was left out
            count = max(float(counted.sum()), 1.0)
            mean = complex(line @ counted / count)
            if abs(mean) < ALIKE * np.sqrt(np.abs(line) ** 2 @ counted / count):
                continue
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

    def describe(self, values: Mapping[str, tuple[float, str]]) -> str:
        f = [v for k, (v, _) in values.items() if k.startswith("frequency")]
        a = [format_length(v) for k, v in values.items() if k.startswith("amplitude")]
        lines = ", ".join(f"{y} at {x:.4g} Hz" for x, y in zip(f, a, strict=True))
        mains = any(abs(x / m - round(x / m)) < 0.004 and x > 40 for x in f for m in (50.0, 60.0))
        source = "mains pick-up: check shielding and earth" if mains else "a machine running nearby"
        return f"The reading contains {lines}, independent of the drive; look for {source}."


def line_for_a_time(frequency_hz: float, size: str, span: str) -> dict[str, str]:
    """Return the texts for a line that is present in only a span of the recordings."""
    return {
        "name": Hum.name,
        "key": "hum-for-a-time",
        "place": Hum.place,
        "title": "Intermittent hum",
        "equation": "y(t) = f(u) + A sin(2 pi f t + phase) from start to end",
        "source": "a machine that runs at times, a supply that is switched",
        "says": f"From {span} the reading contains {size} at {frequency_hz:.4g} Hz, and not at "
        "other times: look for a machine that ran then.",
    }


def _variants(s: Scales) -> list[Block]:
    size = {f"amplitude_{s.unit}": 0.005 * s.stroke}
    return [
        Block("hum", "sensor", {"frequency_hz": f, **size, "phase_rad": phase})
        for f in (50.0, 60.0)
        for phase in (0.3, 1.9)
    ]


PHYSICS = Physics(
    name="hum",
    kinds=(KIND,),
    candidates=lambda data: [Hum(data)],
    specimens={"hum": Specimen(_variants)},
    distinguished_by={"resonance": "a rest of ten seconds with the drive on"},
)
