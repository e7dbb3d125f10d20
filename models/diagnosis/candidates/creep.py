"""Creep: the displacement goes on moving with the logarithm of time after every change."""

from collections.abc import Mapping, Sequence

import numpy as np

from dehyst.models.diagnosis.candidates.interface import Candidate, Parameter, Probe
from dehyst.models.diagnosis.data import Data, Floats
from dehyst.models.diagnosis.kernels import relaxations
from dehyst.models.model import Block

PER_DECADE = 3  # time constants; as in models.blocks.creep, so that the model file says the same
REFERENCE_S = 0.1


def relaxation_times(tau_min_s: float, tau_max_s: float) -> Floats:
    """Log-spaced time constants, about three per decade, both ends included."""
    count = max(1, round(PER_DECADE * float(np.log10(tau_max_s / tau_min_s))) + 1)
    return np.geomspace(tau_min_s, tau_max_s, count)


class Creep(Candidate):
    """y = x + (g / 3) sum_k (low-pass_k(x) - m_k x), m_k = 1 - exp(-0.1 s / tau_k)."""

    name = key = "creep"
    title = "Creep"
    equation = "y(t) = y0 [1 + g log10(t / t0)] after a step, as a sum of relaxations"
    source = "Jung and Gweon, Rev. Sci. Instrum. 71 (2000) 1896; Kelvin-Voigt chains"
    typical = "0.01 to 0.02 per decade"
    revealed_by = "holds of a second and more at several levels"
    confused_with = ("drift", "lag")
    order = 20
    mode = "output"
    limit_unit = "1/decade"
    size_index = 0

    def __init__(self, data: Data) -> None:
        longest = max(float(data.t.max() - data.t.min()), 50 * data.period)
        self.parameters = (
            Parameter("gain_per_decade", "1/decade", 1e-4, 0.3),
            Parameter("tau_min_s", "s", 8 * data.period, 0.2 * longest),
            Parameter("tau_max_s", "s", 0.4 * longest, 10.0 * longest),
        )
        self._longest = longest

    def starts(self, data: Data, residual: Floats) -> list[tuple[float, ...]]:
        long = 3.0 * self._longest
        return [(0.01, max(f * self._longest, 10 * data.period), long) for f in (0.003, 0.02, 0.08)]

    def output(self, data: Data, x: Floats, theta: Sequence[float]) -> Floats:
        taus = relaxation_times(theta[1], theta[2])
        mean = float(np.sum(1.0 - np.exp(-REFERENCE_S / taus)))
        slow = relaxations(x, taus, data.dt, data.starts)
        return x + (theta[0] / PER_DECADE) * (slow - mean * x)

    def probes(self, data: Data) -> list[Probe]:
        taus = (0.02 * self._longest, 3.0 * self._longest)
        return [Probe(float(g), (float(g), *taus)) for g in np.geomspace(1e-4, 0.1, 10)]

    def blocks(self, theta: Sequence[float], amplitudes: Floats, data: Data) -> tuple[Block, ...]:
        keys = ("gain_per_decade", "tau_min_s", "tau_max_s")
        return (Block("creep", "stage", {k: float(v) for k, v in zip(keys, theta, strict=True)}),)

    def says(self, values: Mapping[str, tuple[float, str]]) -> str:
        g = values["gain_per_decade"][0]
        return (
            f"After every move the stage creeps on in the same direction by {100 * g:.2g} % of "
            "the move for each tenfold of time; wait, or let the controller lead."
        )


def candidates(data: Data) -> list[Candidate]:
    return [Creep(data)]
