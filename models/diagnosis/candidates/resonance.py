"""Mechanical resonance: a mode of the stage that rings after steps."""

from collections.abc import Mapping, Sequence

import numpy as np

from dehyst.models.diagnosis.candidates.interface import Candidate, Parameter, Probe
from dehyst.models.diagnosis.data import Data, Floats
from dehyst.models.diagnosis.kernels import second_order
from dehyst.models.diagnosis.peaks import peaks
from dehyst.models.model import Block

MIRRORED = 0.8


class Resonance(Candidate):
    """x (1 - share) + share * mode(x), mode = w^2 / (s^2 + 2 z w s + w^2)."""

    name = "resonance"
    title = "Resonance"
    equation = "w^2 / (s^2 + 2 z w s + w^2) on a share of the stroke"
    source = "mass on the stack's and the guide's stiffness"
    typical = "70 Hz loaded to some kHz, damping 0.005 to 0.05"
    revealed_by = "steps, or a sweep towards the frequency"
    confused_with = ("delay", "lag")
    order = 30
    mode = "output"
    limit_unit = "Hz"
    limit_side = "below"
    repeatable = True
    size_index = 2

    def __init__(self, data: Data, number: int = 0) -> None:
        self.key = "resonance" if number == 0 else f"resonance-{number + 1}"
        self.order = 30 + number
        rate = self._rate = 1.0 / data.period
        longest = float(data.t.max() - data.t.min())
        self.parameters = (
            Parameter(
                "frequency_hz", "Hz", max(4.0 / longest, 1e-3 * rate), 1.5 * rate, sure=1.5e-3
            ),
            Parameter("damping", "1", 5e-4, 0.6, sure=0.02),
            Parameter("share", "1", 0.005, 1.0, sure=0.02),
        )

    def starts(self, data: Data, residual: Floats) -> list[tuple[float, ...]]:
        rate = 1.0 / data.period
        out: list[tuple[float, ...]] = [(f * rate, 0.1, 1.0) for f in (0.04, 0.1, 0.25)]
        for f in peaks(data, residual):
            # a lightly damped mode is missed by a start that is a bandwidth off
            near = f * np.array([0.985, 0.995, 1.0, 1.005, 1.015])
            out += [(float(g), z, 1.0) for g in near for z in (0.01, 0.04)]
            # sampled too slowly, a mode above half the rate rings at its mirror frequency
            out += [(f, 0.1, 1.0), (rate - f, 0.01, 1.0), (rate + f, 0.01, 1.0)]
        return out

    def likely(self, theta: Sequence[float]) -> float:
        # the mirror of a mode rings at the same samples: only where it does clearly better
        return 1.0 if theta[0] < 0.5 * self._rate else MIRRORED

    def output(self, data: Data, x: Floats, theta: Sequence[float]) -> Floats:
        f, z, share = theta
        mode = second_order(x, 2 * np.pi * f * data.dt, z, data.starts)
        return (1.0 - share) * x + share * mode

    def probes(self, data: Data) -> list[Probe]:
        if self.key != "resonance":
            return []
        low, high = np.log10(0.01 / data.period), np.log10(1.4 / data.period)
        frequencies = np.logspace(high, low, 13)  # the higher, the weaker
        return [Probe(float(f), (float(f), 0.02, 1.0)) for f in frequencies]

    def blocks(self, theta: Sequence[float], amplitudes: Floats, data: Data) -> tuple[Block, ...]:
        f, z, share = (float(v) for v in theta)
        return (Block("resonance", "stage", {"frequency_hz": f, "damping": z, "share": share}),)

    def says(self, values: Mapping[str, tuple[float, str]]) -> str:
        f, z = values["frequency_hz"][0], values["damping"][0]
        return (
            f"The stage rings at {f:.4g} Hz (damping {z:.2g}) after every quick move; shape the "
            "moves, add damping, or put a notch at this frequency."
        )

    def implausible(self, theta: Sequence[float], amplitudes: Floats, data: Data) -> str:
        if theta[1] > 0.4:
            return "damping above 0.4 does not ring: a lag or a delay does the same"
        return ""


def candidates(data: Data) -> list[Candidate]:
    return [Resonance(data, k) for k in range(3)]
