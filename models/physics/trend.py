"""Drift without a channel: y = x + rate t + amount (1 - exp(-t / tau)), t since the first sample.

This is a warm-up without a recorded temperature. It describes one recording and predicts nothing
for another, and is therefore forward only.
"""

import math
from collections.abc import Mapping, Sequence

import numpy as np

from dehyst.models.model import Block
from dehyst.models.physics.address import Kernel, fields, record
from dehyst.models.physics.candidate import (
    Candidate,
    Context,
    Parameter,
    common_amplitude,
    format_length,
    move_from_zero,
    one_per_recording,
    split_by_recording,
)
from dehyst.models.physics.entry import Physics, Scales, Specimen
from dehyst.models.physics.kind import Kind, Never, Param
from dehyst.models.signals.joined import Data, Floats

PACKED = fields("rate", "amount", "tau")
STATE = fields("elapsed")  # time since the first sample


@Kernel
def step(
    p_at: int, n_p: int, s_at: int, n_s: int, x: float, t: float, dt: float, ch: float
) -> float:
    """Forward."""
    p, s = record(p_at, PACKED), record(s_at, STATE)
    s.elapsed += dt
    return x + p.rate * s.elapsed + p.amount * (1.0 - math.exp(-s.elapsed / p.tau))


KIND = Kind(
    name="trend",
    says="a slow trend of unknown cause",
    places=("stage", "sensor"),
    params=(
        Param("rate_{y}_per_s", "rate", "/s", -1e9, 1e9, "steady rate", default=(0.0,)),
        Param("amount_{y}", "amount", "", -1e9, 1e9, "size of the settling", default=(0.0,)),
        Param("tau_s", "tau", "s", 1e-6, 1e9, "time constant of the settling", default=(1.0,)),
    ),
    packed=PACKED,
    state=STATE,
    step=step,
    inverse=Never("it belongs to one recording", of_one_recording=True),
)


class Trend(Candidate):
    """y + a (1 - exp(-t / tau)), with a separate a and tau for each recording, since each has a
    different past: a warm-up without a recorded temperature. Typical: some 10 nm a minute; shown by
    the same drive repeated over minutes; better, a temperature channel."""

    name = "drift"
    key = "drift-trend"
    title = "Drift without a temperature"
    equation = "y(t) = f(u) + a (1 - exp(-t / tau))"
    source = "warming up after switching on or after a pause"
    confused_with = ("creep",)
    order = 55
    driven = False
    slow = past = True
    minima = 3

    def __init__(self, data: Data) -> None:
        self._unit = data.unit
        self._lengths = _lengths(data)
        self._longest = float(data.t.max() - data.t.min())
        # sooner, it is like the start of a drive; later, a straight line of any time constant
        low, high = 0.05 * self._longest, 20.0 * self._longest
        self.parameters = one_per_recording(data, Parameter("tau_s", "s", low, high))

    def starts(self, data: Data, residual: Floats) -> list[tuple[float, ...]]:
        return [(f * self._longest,) * len(self.parameters) for f in (0.15, 0.5, 3.0)]

    def columns(self, data: Data, context: Context, theta: Sequence[float]) -> Floats:
        # amplitudes are the rises within the recording; the final value of a slow one is not seen
        return _settling(data, theta) / (1.0 - np.exp(-self._lengths / np.array(theta)))

    def values(self, theta: Sequence[float], amplitudes: Floats) -> dict[str, tuple[float, str]]:
        return {
            "tau_s": (float(theta[int(np.argmax(np.abs(amplitudes)))]), "s"),
            "rise_um": (float(np.mean(amplitudes)), self._unit),
        }

    def blocks(self, theta: Sequence[float], amplitudes: Floats, data: Data) -> tuple[Block, ...]:
        # a model has one past: that of the recording with the largest amplitude
        tau = theta[int(np.argmax(np.abs(amplitudes)))]
        one = _settling(data, (tau,) * len(theta))
        added = self.columns(data, Context(data.u, data.y), theta) @ amplitudes
        params: dict[str, float | tuple[float, ...]] = {
            f"rate_{data.unit}_per_s": 0.0,
            f"amount_{data.unit}": common_amplitude(data, one, added),
            "tau_s": float(tau),
        }
        return (Block("trend", "stage", params),)

    def describe(self, values: Mapping[str, tuple[float, str]]) -> str:
        return (
            f"The zero drifts by {format_length(values['rise_um'])} in each recording with a time "
            f"constant of {values['tau_s'][0]:.3g} s, independent of the drive: let it warm up, "
            "and record a temperature."
        )

    def implausible(self, theta: Sequence[float], amplitudes: Floats, data: Data) -> str:
        # more is the stage itself; after a long move, 0.1 of it may still settle
        rise = float(np.abs(amplitudes).max())
        if rise > max(0.3 * float(np.ptp(data.y)), 0.1 * move_from_zero(data)):
            return "a drift of more than a third of the stroke"
        return ""


WAVES = 8  # half waves in a recording, at most: the slowest changes, which a warm room makes


class Wander(Trend):
    """y + sum_k a_k cos(pi k t / T), separate in each recording of length T: a zero that wanders,
    as in a room whose temperature nobody recorded. It predicts no other recording and is not
    written."""

    key = "drift-wander"
    refines = ("drift-trend",)
    alone = True
    beside_model = True
    title = "Zero wander"
    equation = "y(t) = f(u) + sum_k a_k cos(pi k t / T)"
    parameters = ()
    minima = 1

    def __init__(self, data: Data) -> None:
        self._unit = data.unit

    def starts(self, data: Data, residual: Floats) -> list[tuple[float, ...]]:
        return [()]

    def refined_start(self, theta: Sequence[float]) -> tuple[float, ...]:
        return ()

    def columns(self, data: Data, context: Context, theta: Sequence[float]) -> Floats:
        phase = np.pi * (data.t - _begins(data)) / _lengths(data)[data.rec]
        waves = [split_by_recording(data, np.cos(k * phase)) for k in range(1, WAVES + 1)]
        return np.concatenate(waves, axis=1)

    def values(self, theta: Sequence[float], amplitudes: Floats) -> dict[str, tuple[float, str]]:
        size = float(np.sqrt(0.5 * np.sum(amplitudes**2) * WAVES / amplitudes.size))
        return {"wander_rms_um": (size, self._unit)}

    def blocks(self, theta: Sequence[float], amplitudes: Floats, data: Data) -> tuple[Block, ...]:
        return ()

    def describe(self, values: Mapping[str, tuple[float, str]]) -> str:
        return (
            f"The zero wanders by {format_length(values['wander_rms_um'])} rms, independent of the "
            "drive: let the room temperature settle, and record a temperature."
        )

    def implausible(self, theta: Sequence[float], amplitudes: Floats, data: Data) -> str:
        rise = float(np.abs(amplitudes).max())
        return "a drift of more than a third of the stroke" if rise > 0.3 * np.ptp(data.y) else ""


def _begins(data: Data) -> Floats:
    """Return (N,) the time at which the recording of each sample begins."""
    begins = [data.t[data.rec == i].min() for i in range(len(data.names))]
    return np.array(begins)[data.rec]


def _lengths(data: Data) -> Floats:
    """Return (k,) the length of each recording [s]."""
    return np.array([float(np.ptp(data.t[data.rec == i])) for i in range(len(data.names))])


def _settling(data: Data, theta: Sequence[float]) -> Floats:
    """Return (N, k) columns, 1 - exp(-t / tau) in each of k recordings, 0 in the others."""
    return split_by_recording(data, 1.0 - np.exp(-data.t / np.array(theta)[data.rec]))


def _variants(s: Scales) -> list[Block]:
    return [
        Block("trend", "stage", {f"amount_{s.unit}": 0.02 * s.stroke, "tau_s": k * s.seconds})
        for k in (0.3, 0.1, 1.0, 3.0)
    ]


PHYSICS = Physics(
    name="drift",
    kinds=(KIND,),
    candidates=lambda data: [Trend(data), Wander(data)],
    specimens={"trend": Specimen(_variants, "record a temperature as a channel as well")},
)
