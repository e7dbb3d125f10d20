"""Self-heating: the gain depends on the power that the moving stage dissipates.

    y = x [1 + gain w],    tau dw/dt + w = |dx/dt| |x - m|,    tau dm/dt + m = x

The loss of a hysteresis loop is proportional to the square of its size, so that a sine of amplitude
A and frequency f heats in proportion to f A^2, like dielectric loss (P = 2 pi f C tan(delta) U^2;
K. Uchino, S. Hirose, IEEE Trans. UFFC 48, 2001, 307). |dx/dt| |x - m| has a mean of this form about
any slow level m. The heat of a sample acts from the next sample on.
"""

import math
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from numba import njit

from dehyst.models.model import Block
from dehyst.models.physics.address import Kernel, fields, record
from dehyst.models.physics.candidate import Candidate, Context, Parameter
from dehyst.models.physics.entry import Physics, Scales, Specimen
from dehyst.models.physics.kind import Kind, Param, Solved, head_record
from dehyst.models.signals.joined import Bools, Data, Floats

PACKED = fields("gain", "tau")
STATE = fields("x", "level", "heat")  # previous input, its slow level, w
LEAST_GAIN = 0.1  # smallest total gain that the inverse uses
MOST_CHANGE = 0.1  # largest relative change of the gain that heat may explain


@njit(cache=True, nogil=True)
def _warm(s: Any, tau: float, x: float, dt: float) -> None:
    """Advance a record with the fields STATE by dt to the input x."""
    if dt > 0.0:
        keep = math.exp(-dt / tau)
        between = 0.5 * (s.x + x)
        s.level = between + keep * (s.level - between)
        power = abs(x - s.x) / dt * abs(between - s.level)
        s.heat = power + keep * (s.heat - power)
    s.x = x


@Kernel
def step(
    p_at: int, n_p: int, s_at: int, n_s: int, x: float, t: float, dt: float, ch: float
) -> float:
    """Forward."""
    p, s = record(p_at, PACKED), record(s_at, STATE)
    y = x * (1.0 + p.gain * s.heat)
    _warm(s, p.tau, x, dt)
    return y


@Kernel
def solve(
    p_at: int, n_p: int, s_at: int, n_s: int, y: float, t: float, dt: float, ch: float
) -> float:
    """Inverse."""
    p, s = record(p_at, PACKED), record(s_at, STATE)
    x = y / max(1.0 + p.gain * s.heat, LEAST_GAIN)
    _warm(s, p.tau, x, dt)
    return x


def _start(p: Floats, s: Floats, x: float) -> None:
    state = head_record(s, STATE)
    state["x"], state["level"], state["heat"] = x, x, 0.0


KIND = Kind(
    name="self_heating",
    says="a gain that follows the dissipated power",
    places=("stage",),
    params=(
        Param("gain_s_per_{y}2", "gain", "", -1e9, 1e9, "change of gain, by power of the motion"),
        Param("tau_s", "tau", "s", 1e-6, 1e6, "thermal time constant"),
    ),
    packed=PACKED,
    state=STATE,
    step=step,
    start=_start,
    inverse=Solved(solve, memory=True),
    reach_assumes="slow motion (fast motion heats the stage and changes its gain)",
)


@njit(cache=True, nogil=True)
def _heat(x: Floats, tau: float, dt: Floats, starts: Bools, s: Any) -> Floats:
    """Return the (N,) heat that acts at each sample, starting cold in each recording. s: (1,) work
    record of dtype STATE."""
    out = np.empty(x.size)
    for i in range(x.size):
        if starts[i]:
            s[0].x = s[0].level = x[i]
            s[0].heat = 0.0
        out[i] = s[0].heat
        if not starts[i]:
            _warm(s[0], tau, x[i], dt[i])
    return out


class SelfHeating(Candidate):
    """x (1 + g w), w the heat. Typical: some kelvin, some tenths of a per cent of the gain, within
    minutes; shown by a burst of fast full strokes, then a hold."""

    name = "drift"
    key = "drift-self-heating"
    title = "Self-heating"
    equation = "y(t) = f(u) (1 + g w), tau dw/dt + w = |dx/dt| |x - m|"
    source = "dielectric and mechanical loss in the stack (Uchino and Hirose, 2001)"
    confused_with = ("creep", "rate")
    order = 52
    slow = lasting = True

    def __init__(self, data: Data) -> None:
        self._longest = float(data.t.max() - data.t.min())
        self._unit = data.unit
        self.parameters = (Parameter("tau_s", "s", 0.02 * self._longest, 10.0 * self._longest),)

    def starts(self, data: Data, residual: Floats) -> list[tuple[float, ...]]:
        return [(f * self._longest,) for f in (0.06, 0.25, 1.0)]

    def _heat(self, data: Data, x: Floats, tau: float) -> Floats:
        return _heat(x, tau, data.dt, data.starts, np.zeros(1, STATE))

    def columns(self, data: Data, context: Context, theta: Sequence[float]) -> Floats:
        return (context.output * self._heat(data, context.output, theta[0]))[:, None]

    def values(self, theta: Sequence[float], amplitudes: Floats) -> dict[str, tuple[float, str]]:
        return {
            "gain_s_per_um2": (float(amplitudes[0]), f"s/{self._unit}^2"),
            "tau_s": (float(theta[0]), "s"),
        }

    def blocks(self, theta: Sequence[float], amplitudes: Floats, data: Data) -> tuple[Block, ...]:
        gain = {f"gain_s_per_{data.unit}2": float(amplitudes[0])}
        return (Block("self_heating", "stage", {**gain, "tau_s": float(theta[0])}),)

    def describe(self, values: Mapping[str, tuple[float, str]]) -> str:
        gain, tau = values["gain_s_per_um2"][0], values["tau_s"][0]
        return (
            f"The stage heats itself: fast motion {'raises' if gain > 0 else 'lowers'} its gain "
            f"with a time constant of {tau:.3g} s, and it recovers at rest; let it cool, move it "
            "less, or let the controller compensate it."
        )

    def implausible(self, theta: Sequence[float], amplitudes: Floats, data: Data) -> str:
        change = abs(float(amplitudes[0])) * float(self._heat(data, data.y, theta[0]).max())
        return "a change of the gain by more than a tenth" if change > MOST_CHANGE else ""


def _variants(s: Scales) -> list[Block]:
    """Return blocks that change the gain by 2 % after long motion at 0.1 of the highest rate."""
    power = 0.1 * s.stroke * s.stroke * s.rate_max / s.span
    key = f"gain_s_per_{s.unit}2"
    return [
        Block("self_heating", "stage", {key: 0.02 / power, "tau_s": k * s.seconds})
        for k in (0.3, 0.1, 1.0)
    ]


PHYSICS = Physics(
    name="drift",
    kinds=(KIND,),
    candidates=lambda data: [SelfHeating(data)],
    specimens={"self-heating": Specimen(_variants, "record a temperature at the stack as well")},
    distinguished_by={"rate": "a burst of fast full strokes, then a hold"},
)
