"""Coupling from another channel (axis drive, force): y = x + gain (channel - reference).

If the other channel has hysteresis and a lag of its own, like the piezo of a neighbouring axis:

    y = x + sum_i g_i H_i(c),    tau dc/dt + c = (channel - reference) / scale

with H_i the play of width r_i on c.
"""

import math
from collections.abc import Mapping, Sequence

import numpy as np
from numba import njit

from dehyst.models.model import Block
from dehyst.models.physics.address import Kernel, behind, fields, record
from dehyst.models.physics.candidate import (
    Candidate,
    Context,
    Parameter,
    Probe,
    format_length,
    other_causes,
)
from dehyst.models.physics.entry import OTHER_AXIS, Physics, Scales, Specimen
from dehyst.models.physics.kind import Kind, Param, Solved, Values
from dehyst.models.recording import AXIS_CHANNEL
from dehyst.models.signals.filters import lag_step, lowpass, plays
from dehyst.models.signals.joined import Data, Floats

PACKED = fields("gain", "reference")
MEMORY_PACKED = fields("reference", "scale", "tau")  # followed by r / scale, g of n plays
MEMORY_STATE = fields("before", "c", "started")  # previous input, lagged; followed by (n,) plays
HEAD = 3


@Kernel
def step(
    p_at: int, n_p: int, s_at: int, n_s: int, x: float, t: float, dt: float, ch: float
) -> float:
    """Forward."""
    p = record(p_at, PACKED)
    return x + p.gain * (ch - p.reference)


@Kernel
def solve(
    p_at: int, n_p: int, s_at: int, n_s: int, y: float, t: float, dt: float, ch: float
) -> float:
    """Inverse."""
    p = record(p_at, PACKED)
    return y - p.gain * (ch - p.reference)


@njit(cache=True, nogil=True)
def _with_memory(p_at: int, n_p: int, s_at: int, n_s: int, x: float, dt: float, ch: float) -> float:
    p, rows = record(p_at, MEMORY_PACKED), behind(p_at, n_p, HEAD)
    s, h = record(s_at, MEMORY_STATE), behind(s_at, n_s, HEAD)
    n = h.size
    c = (ch - p.reference) / p.scale
    if s.started == 0.0:
        s.before = s.c = c
        s.started = 1.0
    elif p.tau > 0.0 and dt > 0.0:
        trail = p.tau * (c - s.before) / dt
        s.c = lag_step(s.c, s.before, c, trail, math.exp(-dt / p.tau))
        s.before = c
    else:
        s.before = s.c = c
    y = x
    for i in range(n):
        h[i] = max(s.c - rows[i], min(s.c + rows[i], h[i]))
        y += rows[n + i] * h[i]
    return y


@Kernel
def step_with_memory(
    p_at: int, n_p: int, s_at: int, n_s: int, x: float, t: float, dt: float, ch: float
) -> float:
    """Forward, with plays on the channel."""
    return _with_memory(p_at, n_p, s_at, n_s, x, dt, ch)


@Kernel
def solve_with_memory(
    p_at: int, n_p: int, s_at: int, n_s: int, y: float, t: float, dt: float, ch: float
) -> float:
    """Inverse, with plays on the channel."""
    return y - _with_memory(p_at, n_p, s_at, n_s, 0.0, dt, ch)


def _pack(values: Values, dt: float) -> Floats:
    scale = values["scale"][0]
    head = [values["reference"][0], scale, values["tau"][0]]
    return np.concatenate([head, values["thresholds"] / scale, values["gains"]])


def _check(values: Values) -> str:
    if values["gains"].size != values["thresholds"].size:
        return "gains: as many as thresholds are needed"
    return ""


KINDS = (
    Kind(
        name="coupling",
        says="coupling from another channel",
        places=("stage", "sensor"),
        params=(
            Param("gain_{y}_per_unit", "gain", "/unit", -1e6, 1e6, "gain per unit of the channel"),
            Param("reference", "reference", "", -1e9, 1e9, "channel at rest", default=(0.0,)),
        ),
        packed=PACKED,
        step=step,
        inverse=Solved(solve, memory=False),
        channel=True,
    ),
    Kind(
        name="coupled_memory",
        says="coupling from another channel with hysteresis",
        places=("stage", "sensor"),
        params=(
            Param("thresholds", "thresholds", "unit", 0.0, 1e9, "of the plays", many=True),
            Param("gains_{y}", "gains", "", -1e9, 1e9, "of the plays", many=True),
            Param("tau_s", "tau", "s", 0.0, 100.0, "lag of the channel"),
            Param("scale", "scale", "unit", 1e-12, 1e12, "change of the channel that counts as 1"),
            Param("reference", "reference", "", -1e9, 1e9, "channel at rest", default=(0.0,)),
        ),
        packed=MEMORY_PACKED,
        state=MEMORY_STATE,
        step=step_with_memory,
        pack=_pack,
        size=lambda p, dt: HEAD + (p.size - HEAD) // 2,
        inverse=Solved(solve_with_memory, memory=True),
        channel=True,
        check=_check,
    ),
)

LAGS = 12  # time constants to start from: each 1.7 times the one before
FRACTIONS = np.array([0.0, 0.03, 0.1, 0.2, 0.35])  # widths of the plays, of the channel's range


def coupled(unit: str, gain: float, reference: float, channel: str) -> Block:
    """Return the block that adds gain (channel - reference); gain: [unit / channel's unit]."""
    return Block(
        "coupling", "stage", {f"gain_{unit}_per_unit": gain, "reference": reference}, channel
    )


class Coupling(Candidate):
    """y + g c(t) for a channel c. Typical: 1 to 5 % of the other axis; shown by the other channel
    moving while the own drive rests."""

    name = "coupling"
    equation = "y(t) = f(u) + g c(t)"
    source = "parasitic motion of a neighbouring axis, or a load"
    confused_with = ("drift",)
    order = 60
    driven = False

    def __init__(self, channel: str, reference: float, unit: str, drive_unit: str = "v") -> None:
        self.channel = channel
        self.key = f"coupling-{channel}"
        self.title = f"Coupling from {channel}"
        self.reference = reference
        axis = AXIS_CHANNEL.fullmatch(channel)
        self.unit = channel.rsplit("_", 1)[-1]
        self.whose = f"The channel {channel}"
        if axis:
            self.unit = drive_unit if axis[2] else unit
            self.whose = f"The {'drive' if axis[2] else 'displacement'} of axis {axis[1]}"
        self.limit_unit = f"{unit}/{self.unit}"

    def columns(self, data: Data, context: Context, theta: Sequence[float]) -> Floats:
        return (data.channels[self.channel] - self.reference)[:, None]

    def values(self, theta: Sequence[float], amplitudes: Floats) -> dict[str, tuple[float, str]]:
        return {"gain_um_per_unit": (float(amplitudes[0]), self.limit_unit)}

    def probes(self, data: Data) -> list[Probe]:
        return [Probe(1.0, (), (1.0,))]

    def blocks(self, theta: Sequence[float], amplitudes: Floats, data: Data) -> tuple[Block, ...]:
        return (coupled(data.unit, float(amplitudes[0]), self.reference, self.channel),)

    def describe(self, values: Mapping[str, tuple[float, str]]) -> str:
        gain = format_length(values["gain_um_per_unit"])
        return f"{self.whose} moves this reading by {gain}: the axes are not decoupled."


class LaggedCoupling(Coupling):
    """Coupling through a first-order lag, by plays on the channel. scale: change of the channel
    that counts as 1; widths: of the plays, relative to it."""

    order = 61
    scale = 1.0
    widths: Floats = np.zeros(1)  # no hysteresis

    def columns(self, data: Data, context: Context, theta: Sequence[float]) -> Floats:
        c = super().columns(data, context, theta) / self.scale
        return plays(self.widths, lowpass(c, data.dt / theta[0], data.starts)[:, 0], data.starts)

    def values(self, theta: Sequence[float], amplitudes: Floats) -> dict[str, tuple[float, str]]:
        gain = float(np.sum(amplitudes * (1.0 - self.widths))) / self.scale
        return {"gain_um_per_unit": (gain, self.limit_unit), "tau_s": (float(theta[0]), "s")}

    def probes(self, data: Data) -> list[Probe]:
        return []

    def blocks(self, theta: Sequence[float], amplitudes: Floats, data: Data) -> tuple[Block, ...]:
        params: dict[str, float | tuple[float, ...]] = {
            "thresholds": tuple(float(r) for r in self.widths * self.scale),
            f"gains_{data.unit}": tuple(float(g) for g in amplitudes),
            "tau_s": float(theta[0]),
            "scale": self.scale,
            "reference": self.reference,
        }
        return (Block("coupled_memory", "stage", params, self.channel),)


class CoupledLag(LaggedCoupling):
    """Coupling through a first-order lag: of the other amplifier, or of the gauge that reads both
    motions."""

    equation = "y(t) = f(u) + g c, c after a lag"
    alone = True

    def __init__(self, data: Data, channel: str, reference: float) -> None:
        super().__init__(channel, reference, data.unit, data.drive_unit)
        self.key = f"coupledlag-{channel}"
        self.refines = (f"coupling-{channel}",)
        self.title = f"Coupling from {channel} through a lag"
        self.parameters = (Parameter("tau_s", "s", 0.3 * data.period, 300 * data.period),)

    def starts(self, data: Data, residual: Floats) -> list[tuple[float, ...]]:
        p = self.parameters[0]
        return [(float(tau),) for tau in np.geomspace(2 * p.low, 0.5 * p.high, LAGS)]

    def refined_start(self, theta: Sequence[float]) -> tuple[float, ...]:
        return (self.parameters[0].low * 7,)

    def describe(self, values: Mapping[str, tuple[float, str]]) -> str:
        gain, lag = format_length(values["gain_um_per_unit"]), 1e3 * values["tau_s"][0]
        return (
            f"{self.whose} moves this reading by {gain}, after a lag of {lag:.3g} ms: the axes are "
            "not decoupled."
        )


class CoupledMemory(LaggedCoupling):
    """Coupling from an axis with a lag and hysteresis of its own: plays on its drive."""

    equation = "y(t) = f(u) + sum_i g_i H_i(c), c after a lag"
    contains = ("coupling",)
    widths = FRACTIONS

    def __init__(self, data: Data, channel: str, reference: float) -> None:
        super().__init__(channel, reference, data.unit, data.drive_unit)
        self.key = f"coupling2-{channel}"
        self.refines = (f"coupling-{channel}", f"coupledlag-{channel}")
        self.scale = float(np.ptp(data.channels[channel]))
        self.parameters = (Parameter("tau_s", "s", 0.1 * data.period, 300 * data.period),)

    def refined_start(self, theta: Sequence[float]) -> tuple[float, ...]:
        return tuple(theta) or (self.parameters[0].low * 20,)


def _candidates(data: Data) -> list[Candidate]:
    out: list[Candidate] = []
    for c in other_causes(data):
        reference = float(data.channels[c].mean())
        out += [
            Coupling(c, reference, data.unit, data.drive_unit),
            CoupledLag(data, c, reference),
            CoupledMemory(data, c, reference),
        ]
    return out


def _variants(s: Scales) -> list[Block]:
    key = f"gain_{s.unit}_per_unit"
    return [Block("coupling", "stage", {key: 0.02 * s.stroke / s.span}, OTHER_AXIS)]


PHYSICS = Physics(
    name="coupling",
    kinds=KINDS,
    candidates=_candidates,
    specimens={
        "coupling": Specimen(_variants, "move the other axis on its own, and record its drive")
    },
    distinguished_by={"drift": "a rest of the own axis while only the other one moves"},
)
