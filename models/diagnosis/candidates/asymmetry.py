"""A loop that is not symmetric, as far as the rich base cannot make it: a one-sided dead band."""

from collections.abc import Mapping, Sequence

import numpy as np

from dehyst.models.diagnosis.candidates.interface import Candidate, Context, Parameter, Probe
from dehyst.models.diagnosis.data import Data, Floats
from dehyst.models.diagnosis.kernels import plays
from dehyst.models.model import Block


class Asymmetry(Candidate):
    """y + a max(u - H_r, 0)^2 + b max(H_r - u, 0)^2."""

    name = key = "asymmetry"
    title = "Loop that is not symmetric"
    equation = "y = f(u) + a max(u - H_r, 0)^2 + b max(H_r - u, 0)^2"
    source = "one-sided dead zones, after Kuhnen 2003; bias of unipolar stacks"
    typical = "one branch of the loop steeper than the other"
    revealed_by = "full loops and small loops about several levels"
    confused_with = ("sensor", "friction", "clip")
    order = 64
    static = True

    def __init__(self, data: Data) -> None:
        self.limit_unit = f"{data.unit}/{data.drive_unit}^2"
        self._span = data.span
        self._low = data.u_min
        self.parameters = (
            Parameter(f"threshold_{data.drive_unit}", data.drive_unit, 3e-3 * data.span,
                      0.45 * data.span),
        )  # fmt: skip

    def starts(self, data: Data, residual: Floats) -> list[tuple[float, ...]]:
        return [(f * data.span,) for f in (0.03, 0.07, 0.12, 0.18, 0.27)]

    def columns(self, data: Data, context: Context, theta: Sequence[float]) -> Floats:
        v = context.v - self._low
        ahead = v - plays(np.array([theta[0]]), v, data.starts)[:, 0]
        return np.column_stack([np.maximum(ahead, 0.0) ** 2, np.minimum(ahead, 0.0) ** 2])

    def probes(self, data: Data) -> list[Probe]:
        return [Probe(1.0, (0.1 * self._span,), (1.0, 0.0))]

    def blocks(self, theta: Sequence[float], amplitudes: Floats, data: Data) -> tuple[Block, ...]:
        params: dict[str, float | tuple[float, ...]] = {
            f"threshold_{data.drive_unit}": float(theta[0]),
            f"rising_{data.unit}_per_{data.drive_unit}2": float(amplitudes[0]),
            f"falling_{data.unit}_per_{data.drive_unit}2": float(amplitudes[1]),
            f"center_{data.drive_unit}": self._low,
        }
        return (Block("one_sided", "stage", params),)

    def says(self, values: Mapping[str, tuple[float, str]]) -> str:
        return (
            "Rising and falling differ by more than a hysteresis of any usual shape would make; "
            "the identified loop needs its asymmetric terms. A nonlinear sensor or friction in the "
            "guide can look alike."
        )


def candidates(data: Data) -> list[Candidate]:
    return [Asymmetry(data)]
