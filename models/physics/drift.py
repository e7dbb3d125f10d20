"""Drift with temperature: y = x [1 + gain w] + expansion w.

w is the temperature of a channel minus the reference, or lags it with the thermal time constant of
the stage: tau dw/dt + w = T - T0.
"""

import math
from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np
from numba import njit

from dehyst.models.model import Block
from dehyst.models.physics.address import Kernel, fields, record
from dehyst.models.physics.candidate import Candidate, Context, Parameter, Probe, format_length
from dehyst.models.physics.entry import TEMPERATURE, Physics, Scales, Specimen
from dehyst.models.physics.kind import Kind, Param, Solved
from dehyst.models.signals.filters import lag_step, lowpass
from dehyst.models.signals.joined import Data, Floats

PACKED = fields("gain", "expansion", "reference")
SLOW_PACKED = fields("gain", "expansion", "reference", "tau")
SLOW_STATE = fields("before", "warm", "started")  # previous temperature, that of the stage
LEAST_GAIN = 0.1  # smallest total gain that the inverse uses


@Kernel
def step(
    p_at: int, n_p: int, s_at: int, n_s: int, x: float, t: float, dt: float, ch: float
) -> float:
    """Forward."""
    p = record(p_at, PACKED)
    warm = ch - p.reference
    return x * (1.0 + p.gain * warm) + p.expansion * warm


@Kernel
def solve(
    p_at: int, n_p: int, s_at: int, n_s: int, y: float, t: float, dt: float, ch: float
) -> float:
    """Inverse."""
    p = record(p_at, PACKED)
    warm = ch - p.reference
    return (y - p.expansion * warm) / max(1.0 + p.gain * warm, LEAST_GAIN)


@njit(cache=True, nogil=True)
def _warmed(p_at: int, s_at: int, dt: float, ch: float) -> float:
    """Advance by one sample and return the stage's temperature above the reference."""
    p, s = record(p_at, SLOW_PACKED), record(s_at, SLOW_STATE)
    warm = ch - p.reference
    if s.started == 0.0 or dt <= 0.0:
        s.warm = warm
        s.started = 1.0
    else:
        trail = p.tau * (warm - s.before) / dt
        s.warm = lag_step(s.warm, s.before, warm, trail, math.exp(-dt / p.tau))
    s.before = warm
    return s.warm


@Kernel
def step_slow(
    p_at: int, n_p: int, s_at: int, n_s: int, x: float, t: float, dt: float, ch: float
) -> float:
    """Forward, with a thermal lag."""
    p, warm = record(p_at, SLOW_PACKED), _warmed(p_at, s_at, dt, ch)
    return x * (1.0 + p.gain * warm) + p.expansion * warm


@Kernel
def solve_slow(
    p_at: int, n_p: int, s_at: int, n_s: int, y: float, t: float, dt: float, ch: float
) -> float:
    """Inverse, with a thermal lag."""
    p, warm = record(p_at, SLOW_PACKED), _warmed(p_at, s_at, dt, ch)
    return (y - p.expansion * warm) / max(1.0 + p.gain * warm, LEAST_GAIN)


def _params(most_gain: float) -> tuple[Param, ...]:
    return (
        Param("gain_per_k", "gain", "1/K", -most_gain, most_gain, "change of gain"),
        Param("expansion_{y}_per_k", "expansion", "/K", -1e6, 1e6, "expansion"),
        Param("reference_c", "reference", "degC", -273.15, 1000.0, "temperature without drift"),
    )


MOST_GAIN, MOST_SLOW_GAIN = 0.2, 2.0
KINDS = (
    Kind(
        name="drift",
        says="drift with temperature",
        places=("stage", "sensor"),
        params=_params(MOST_GAIN),
        packed=PACKED,
        step=step,
        inverse=Solved(solve, memory=False),
        channel=True,
    ),
    Kind(
        name="slow_drift",
        says="drift with temperature through a thermal lag",
        places=("stage", "sensor"),
        params=(
            *_params(MOST_SLOW_GAIN),
            Param("tau_s", "tau", "s", 1e-9, 1e6, "thermal time constant"),
        ),
        packed=SLOW_PACKED,
        state=SLOW_STATE,
        step=step_slow,
        inverse=Solved(solve_slow, memory=True),
        channel=True,
    ),
)


class Drift(Candidate):
    """y (1 + a dT) + b dT for a temperature channel, dT relative to its mean. Typical: 0.01 / K,
    0.1 um / K; shown by minutes of recording while the temperature moves."""

    name = "drift"
    title = "Drift with the temperature"
    equation = "y(t) = f(u) (1 + a dT) + b dT"
    source = "thermal expansion of the frame; temperature coefficient of the ceramic"
    confused_with = ("creep",)
    order = 50
    driven = False
    slow = True

    def __init__(self, data: Data, channel: str) -> None:
        self.channel = channel
        self.key = f"drift-{channel}"
        self.reference = float(data.channels[channel].mean())
        self.limit_unit = f"{data.unit}/K"

    def columns(self, data: Data, context: Context, theta: Sequence[float]) -> Floats:
        warm = data.channels[self.channel] - self.reference
        return np.column_stack([warm, warm * context.output])

    def values(self, theta: Sequence[float], amplitudes: Floats) -> dict[str, tuple[float, str]]:
        return {
            "expansion_um_per_k": (float(amplitudes[0]), self.limit_unit),
            "gain_per_k": (float(amplitudes[1]), "1/K"),
        }

    def probes(self, data: Data) -> list[Probe]:
        return [Probe(1.0, (), (1.0, 0.0))]

    def blocks(self, theta: Sequence[float], amplitudes: Floats, data: Data) -> tuple[Block, ...]:
        params: dict[str, float | tuple[float, ...]] = {
            "gain_per_k": float(amplitudes[1]),
            f"expansion_{data.unit}_per_k": float(amplitudes[0]),
            "reference_c": self.reference,
        }
        if abs(float(amplitudes[1])) > MOST_GAIN:  # beyond the range of the plain block
            params["tau_s"] = 1e-3 * data.period
            return (Block("slow_drift", "stage", params, self.channel),)
        return (Block("drift", "stage", params, self.channel),)

    def implausible(self, theta: Sequence[float], amplitudes: Floats, data: Data) -> str:
        too_much = abs(float(amplitudes[1])) > MOST_SLOW_GAIN
        return "more than twice the gain per kelvin" if too_much else ""

    def describe(self, values: Mapping[str, tuple[float, str]]) -> str:
        b, a = format_length(values["expansion_um_per_k"]), values["gain_per_k"][0]
        return (
            f"The stage drifts with temperature: its zero by {b} and its gain by {100 * a:.2g} % "
            "per kelvin; connect a temperature sensor to the controller, or shield the stage."
        )


class SlowDrift(Drift):
    """Drift that lags the temperature by one thermal time constant."""

    equation = "y(t) = f(u) (1 + a dT) + b dT, dT after a thermal lag"
    contains = ("drift",)
    order = 51

    def __init__(self, data: Data, channel: str) -> None:
        super().__init__(data, channel)
        self.key = f"drift2-{channel}"
        self.refines = (f"drift-{channel}",)
        longest = float(data.t.max() - data.t.min())
        self.parameters = (Parameter("tau_s", "s", 5 * data.period, 2.0 * longest),)

    def refined_start(self, theta: Sequence[float]) -> tuple[float, ...]:
        return (max(0.02 * self.parameters[0].high, 2 * self.parameters[0].low),)

    def probes(self, data: Data) -> list[Probe]:
        return []

    def columns(self, data: Data, context: Context, theta: Sequence[float]) -> Floats:
        warm = (data.channels[self.channel] - self.reference)[:, None]
        warm = lowpass(warm, data.dt / theta[0], data.starts)[:, 0]
        return np.column_stack([warm, warm * context.output])

    def values(self, theta: Sequence[float], amplitudes: Floats) -> dict[str, tuple[float, str]]:
        return {**super().values(theta, amplitudes), "tau_s": (float(theta[0]), "s")}

    def blocks(self, theta: Sequence[float], amplitudes: Floats, data: Data) -> tuple[Block, ...]:
        (block,) = super().blocks(theta, amplitudes, data)
        params = {**block.params, "tau_s": float(theta[0])}
        return (replace(block, kind="slow_drift", params=params),)


def _candidates(data: Data) -> list[Candidate]:
    return [
        kind(data, c) for c in data.channels if c.startswith("temp") for kind in (Drift, SlowDrift)
    ]


def _variants(s: Scales) -> list[Block]:
    key = f"expansion_{s.unit}_per_k"
    return [
        Block("drift", "stage", {"gain_per_k": g, key: b, "reference_c": 22.0}, TEMPERATURE)
        for g, b in ((0.0, 0.01 * s.stroke), (0.01, 0.0))
    ]


PHYSICS = Physics(
    name="drift",
    kinds=KINDS,
    candidates=_candidates,
    specimens={
        "drift": Specimen(_variants, "record the temperature, and let it change during the run")
    },
)
