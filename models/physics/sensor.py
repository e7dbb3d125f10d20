"""A reading that is a nonlinear function of the displacement alone.

    polynomial  y = a_0 + a_1 x + a_2 x^2 + ...            (also for what the stage itself does)
    ripple      y = x + a sin(2 pi x / p) + b cos(2 pi x / p) - b

The ripple is the interpolation error of encoders and interferometers, or another error that repeats
along the range; it belongs to the reading. Only the ripple is recognised: recordings of one stage
cannot distinguish a smooth static error of the reading from the shape of the hysteresis, and the
base absorbs it.
"""

import math
from collections.abc import Mapping, Sequence

import numpy as np

from dehyst.models.hysteresis.forward import polynomial
from dehyst.models.model import Block
from dehyst.models.physics.address import Kernel, fields, numbers, record
from dehyst.models.physics.candidate import Candidate, Context, Parameter, Probe, format_length
from dehyst.models.physics.entry import Physics, Scales, Specimen
from dehyst.models.physics.kind import Kind, Never, Param, Solved, Values, head_record
from dehyst.models.signals.joined import Data, Floats
from dehyst.models.signals.rounding import quantum

GUESS = fields("input")  # start value of the inverse; NaN: the output itself
RIPPLE = fields("period", "sine", "cosine")

RESOLVED = 2.0
"""Steps of the reading in the shortest period of a ripple: one step is its rounding, and fewer than
two show no wave."""
COARSEST = 0.1
"""Largest step of the reading, as a fraction of its range, with which a ripple is looked for: its
longest period is 0.4 of the range."""


@Kernel
def step_polynomial(
    p_at: int, n_p: int, s_at: int, n_s: int, x: float, t: float, dt: float, ch: float
) -> float:
    """Forward. Parameters: ascending coefficients."""
    return polynomial(numbers(p_at, n_p), x)


@Kernel
def solve_polynomial(
    p_at: int, n_p: int, s_at: int, n_s: int, y: float, t: float, dt: float, ch: float
) -> float:
    """Inverse, near the previous input, by Newton steps that are halved while the error grows. Ends
    when no step reduces the error, or the slope is 0."""
    p, s = numbers(p_at, n_p), record(s_at, GUESS)
    x = y if math.isnan(s.input) else s.input
    error = polynomial(p, x) - y
    for _ in range(60):
        slope = 0.0
        for j in range(p.size - 1, 0, -1):
            slope = slope * x + j * p[j]
        if error == 0.0 or slope == 0.0:
            break
        move = -error / slope
        for _ in range(30):
            trial = polynomial(p, x + move) - y
            if abs(trial) < abs(error):
                break
            move *= 0.5
        if abs(trial) >= abs(error):
            break
        x += move
        error = trial
    s.input = x
    return x


@Kernel
def step_ripple(
    p_at: int, n_p: int, s_at: int, n_s: int, x: float, t: float, dt: float, ch: float
) -> float:
    """Forward."""
    p = record(p_at, RIPPLE)
    angle = 2.0 * math.pi * x / p.period
    return x + p.sine * math.sin(angle) + p.cosine * (math.cos(angle) - 1.0)


def _start(p: Floats, s: Floats, x: float) -> None:
    head_record(s, GUESS)["input"] = math.nan


def _check(values: Values) -> str:
    return "" if values["coefficients"].size >= 2 else "coefficients: two or more are needed"


KINDS = (
    Kind(
        name="polynomial",
        says="a static nonlinearity",
        places=("stage", "sensor"),
        params=(Param("coefficients", "coefficients", "", -1e12, 1e12, "ascending", many=True),),
        state=GUESS,
        step=step_polynomial,
        pack=lambda values, dt: values["coefficients"],
        start=_start,
        inverse=Solved(solve_polynomial, memory=False),
        check=_check,
    ),
    Kind(
        name="ripple",
        says="a periodic error of the reading along the range",
        places=("sensor",),
        params=(
            Param("period_{y}", "period", "", 1e-9, 1e9, "displacement from one error to the next"),
            Param("sine_{y}", "sine", "", -1e9, 1e9, "amplitude of the sine"),
            Param("cosine_{y}", "cosine", "", -1e9, 1e9, "amplitude of the cosine"),
        ),
        packed=RIPPLE,
        step=step_ripple,
        inverse=Never("it is an error of the reading, not a motion of the stage"),
    ),
)


class NonlinearSensor(Candidate):
    """y = x + a sin(2 pi x / p) + b (cos(2 pi x / p) - 1). Typical: 0.1 to 1 % of the range; shown
    by slow full strokes; settled by a calibration against another sensor."""

    name = key = "sensor"
    title = "Nonlinear sensor"
    equation = "y = x + a sin(2 pi x / p) + b (cos(2 pi x / p) - 1)"
    source = "interpolation error of encoders and interferometers"
    confused_with = ("asymmetry", "friction")
    order = 80
    static = True
    place = "sensor"

    def __init__(self, data: Data) -> None:
        self.limit_unit = data.unit
        self._range = float(np.ptp(data.y))
        self._shortest = max(0.02 * self._range, RESOLVED * quantum(data.y))
        self.parameters = (Parameter("period_um", data.unit, self._shortest, 0.4 * self._range),)

    def starts(self, data: Data, residual: Floats) -> list[tuple[float, ...]]:
        # spacing of half a period over the range, so that the search cannot miss one in between
        counts = np.arange(2.7, 45.0, 0.5) if self._range > 0 else np.zeros(0)
        periods = self._range / counts
        periods = periods[periods >= self._shortest]
        order = _strongest(data.y[data.rows], residual[data.rows], periods)
        return [(float(p),) for p in order[:3]]

    def columns(self, data: Data, context: Context, theta: Sequence[float]) -> Floats:
        angle = 2 * np.pi * context.output / theta[0]
        return np.column_stack([np.sin(angle), np.cos(angle) - 1.0])

    def can_count_when_small(self, theta: Sequence[float]) -> bool:
        return False

    def plausibility_weight(self, theta: Sequence[float], amplitudes: Floats) -> float:
        return float(np.hypot(*amplitudes) <= self._range)

    def implausible(self, theta: Sequence[float], amplitudes: Floats, data: Data) -> str:
        if np.hypot(*amplitudes) <= self._range:
            return ""
        return "its error would exceed the range of the reading"

    def values(self, theta: Sequence[float], amplitudes: Floats) -> dict[str, tuple[float, str]]:
        unit = self.parameters[0].unit
        return {
            "period_um": (float(theta[0]), unit),
            "amplitude_um": (float(np.hypot(*amplitudes)), unit),
        }

    def probes(self, data: Data) -> list[Probe]:
        return [Probe(1.0, (0.2 * self._range,), (1.0, 0.0))]

    def blocks(self, theta: Sequence[float], amplitudes: Floats, data: Data) -> tuple[Block, ...]:
        params: dict[str, float | tuple[float, ...]] = {
            f"period_{data.unit}": float(theta[0]),
            f"sine_{data.unit}": float(amplitudes[0]),
            f"cosine_{data.unit}": float(amplitudes[1]),
        }
        return (Block("ripple", "sensor", params),)

    def describe(self, values: Mapping[str, tuple[float, str]]) -> str:
        return (
            f"The reading has a periodic error of {format_length(values['amplitude_um'])} that "
            f"repeats every {format_length(values['period_um'])} along the range: calibrate the "
            "sensor; do not correct this with the drive."
        )


def _strongest(y: Floats, residual: Floats, periods: Floats) -> Floats:
    """Return the periods in order of the residual's power, averaged over bins of the reading."""
    bins = np.linspace(y.min(), y.max(), 401)
    place = np.clip(np.digitize(y, bins) - 1, 0, 399)
    count = np.bincount(place, minlength=400)
    mean = np.bincount(place, residual, 400) / np.maximum(count, 1)
    centre = 0.5 * (bins[1:] + bins[:-1])
    weight = np.sqrt(count)
    power = [abs(np.sum(weight * mean * np.exp(-2j * np.pi * centre / p))) for p in periods]
    return periods[np.argsort(power)[::-1]]


def _variants(s: Scales) -> list[Block]:
    k = "coefficients"
    return [
        Block("polynomial", "sensor", {k: (0.0, 1.0, 0.02 / s.stroke)}),
        Block("polynomial", "sensor", {k: (0.0, 1.0, 0.0, 0.02 / s.stroke**2)}),
    ]


def _candidates(data: Data) -> list[Candidate]:
    coarse = quantum(data.y) > COARSEST * float(np.ptp(data.y))
    return [] if coarse else [NonlinearSensor(data)]


PHYSICS = Physics(
    name="sensor",
    kinds=KINDS,
    candidates=_candidates,
    looks={"centre": 1, "branches": 2, "presliding": 3, "class": 3},
    specimens={
        "sensor": Specimen(
            _variants,
            "only a calibrated second sensor distinguishes it from the stage for certain",
            True,
        )
    },
)
