"""One mechanical mode: y = (1 - share) x + share q,  q'' + 2 z w q' + w^2 q = w^2 x.

The form is exact for an input that is linear between the samples, or held (`kind.HELD`), for any
damping z.
"""

import math
from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np
from numba import njit

from dehyst.models.model import Block
from dehyst.models.physics.address import Kernel, fields, record
from dehyst.models.physics.candidate import Candidate, Parameter, Probe
from dehyst.models.physics.entry import Physics, Scales, Specimen
from dehyst.models.physics.kind import (
    HELD,
    SAME,
    STATES,
    Kind,
    Led,
    Param,
    Values,
    head_record,
    held_key,
)
from dehyst.models.signals.filters import free_decay, second_order, second_order_step
from dehyst.models.signals.joined import Data, Floats
from dehyst.models.signals.peaks import peaks
from dehyst.models.signals.periodic import fastest_hz

# hold [s]: 0 where the input moves in straight lines
PACKED = fields("frequency", "damping", "share", "hold")
# displacement and speed of the mode, previous input; dt of the decay, and the free decay over dt as
# a 2 x 2 matrix: (e, e') after = M (e, e') before
MODE = ("q", "speed", "x", "dt", "m11", "m12", "m21", "m22")
STATE = fields(*MODE)
UNDOING = 8 * len(MODE)  # offset of the state of `solve` [bytes]
RINGS_S, ZIGZAG = 0.5, 0.5
"""Limits of the inverse: the longest decay time [s] of the drive's ringing after a step, and the
largest factor from sample to sample of an alternating drive
(tests/benchmarks/daemon/second_act_offline: rings for 0.05 to 0.15 s, does not alternate)."""


@njit(cache=True, nogil=True)
def move_mode(s: Any, frequency: float, damping: float, x: float, dt: float, held: bool) -> None:
    """Advance a mode, a record with the fields MODE, by dt to the input x, along a straight line or
    (held) at x all the time."""
    if dt > 0.0:
        w, z = 2.0 * math.pi * frequency, damping
        if abs(dt - s.dt) > SAME * dt:
            s.dt = dt
            s.m11, s.m12, s.m21, s.m22 = free_decay(w, z, dt)
        before = x if held else s.x
        ramp = (x - before) / dt
        shift = 2.0 * z / w * ramp
        decay = (s.m11, s.m12, s.m21, s.m22)
        s.q, s.speed = second_order_step(s.q, s.speed, before, x, ramp, shift, decay)
    s.x = x


@Kernel
def step(
    p_at: int, n_p: int, s_at: int, n_s: int, x: float, t: float, dt: float, ch: float
) -> float:
    """Forward."""
    p, s = record(p_at, PACKED), record(s_at, STATE)
    move_mode(s, p.frequency, p.damping, x, dt, p.hold > 0.0)
    return (1.0 - p.share) * x + p.share * s.q


def _pack(values: Values, dt: float) -> Floats:
    own = [values[name][0] for name in ("frequency", "damping", "share")]
    return np.array([*own, values["held"][0] * dt])


def _lead(p: Floats) -> tuple[float, float]:
    """Return the factors of the series of 1 / (1 - share + share mode): a hold is ahead of straight
    lines by half of it."""
    frequency, damping, share, hold = p
    w, half = 2.0 * np.pi * frequency, 0.5 * hold
    a1 = 2.0 * damping / w
    first = share * (a1 - half)
    second = share * (a1 * a1 - 1.0 / (w * w) - a1 * half + 2.0 / 3.0 * half * half)
    return first, first * first - second


@Kernel
def solve(
    p_at: int, n_p: int, s_at: int, n_s: int, y: float, t: float, dt: float, ch: float
) -> float:
    """Inverse: return the input x for which a line from the previous input to x, or x held, makes
    the output y. The mode has a separate state, unaffected by limits of the drive. It is used where
    `_is_solved` holds."""
    p, s = record(p_at, PACKED), record(s_at + UNDOING, STATE)
    x = y
    if dt > 0.0:
        w, z = 2.0 * math.pi * p.frequency, p.damping
        m11, m12, _, _ = free_decay(w, z, dt)
        if p.hold > 0.0:
            free = m11 * s.q + m12 * s.speed
            x = (y - p.share * free) / (1.0 - p.share * m11)
        else:
            turn = (2.0 * z / w * (m11 - 1.0) - m12) / dt  # response of q - x to a rise of the line
            free = m11 * (s.q - s.x) + m12 * s.speed
            x = (y + p.share * (turn * s.x - free)) / (1.0 + p.share * turn)
    move_mode(s, p.frequency, p.damping, x, dt, p.hold > 0.0)
    return x


def _is_solved(p: Floats, dt: float) -> bool:
    """Return whether `solve` is stable at this period. That requires a part of the stroke that
    bypasses the mode: if the mode carries nearly all of it, its sampled form has zeros outside the
    unit circle or close to -1 (Astrom, Hagander, Sternby, Automatica 20, 1984, 31)."""
    free = np.zeros((3, 3))  # transition of mode, speed and input while the output is kept at 0
    own = slice(len(MODE), len(MODE) + 3)
    for k, one in enumerate(np.diag((1.0, 1.0 / dt, 1.0))):
        state = np.zeros(STATES * len(MODE))
        state[own] = one
        solve(p, state, 0.0, dt=dt)
        free[:, k] = state[own] * (1.0, dt, 1.0)
    zeros = np.linalg.eigvals(free)
    rings = float(np.max(np.abs(zeros)))
    return rings <= math.exp(-dt / RINGS_S) and float(np.min(zeros.real)) >= -ZIGZAG


def _start(p: Floats, s: Floats, x: float) -> None:
    state = head_record(s, STATE)
    state["q"] = state["x"] = x


KIND = Kind(
    name="resonance",
    says="a mechanical resonance",
    places=("stage", "sensor"),
    params=(
        Param("frequency_hz", "frequency", "Hz", 1e-3, 1e6, "natural frequency"),
        Param("damping", "damping", "", 1e-6, 10.0, "damping ratio"),
        Param("share", "share", "", 0.0, 1.0, "part of the stroke that the mode carries"),
        HELD,
    ),
    pack=_pack,
    packed=PACKED,
    state=STATE,
    step=step,
    size=lambda p, dt: STATES * len(MODE),
    start=_start,
    inverse=Led(_lead, solve, _is_solved),
)

MIRRORED = 0.8  # weight of a mode above half the sampling rate against its mirror below it
HIGHEST_EXCLUDED = 0.25  # of the sampling rate: how much the drive between two samples excites
# higher modes is unknown
RINGS_WITHIN = 3.0
"""Highest frequency, relative to the drive's fastest part: a mode above that does not ring, and a
loop of another shape or creep may imitate it (tests/benchmarks/models/proof: slow scans)."""
SURE_DAMPING = 0.2
"""Relative uncertainty of the damping: the drive between two samples, which also excites the mode,
is unknown (tests/benchmarks/models/proof: 0.0140 was reported as 0.0120)."""


SURE_SHARE, OPEN_SHARE = 0.2, 0.6
"""Relative uncertainty of the share, at least and at most. A mode is excited by small motions, and
share times the loop's gain for these is what the recordings fix; where the loop is of another class
than the model's, that gain is known to a fifth (tests/benchmarks/models/proof: shares of 0.04 to
0.4 were reported 3 to 20 % too large)."""
RINGS_LONG = 0.05  # damping below which a mode rings for some periods
NO_RING = 0.4  # damping above which it does not ring; damping at the frequency seen in the samples
LOST = 1.25  # uncertainty of the share, per amplitude that linear interpolation loses at the mode


class Resonance(Candidate):
    """x (1 - share) + share * mode(x), mode = w^2 / (s^2 + 2 z w s + w^2). Typical: 70 Hz loaded to
    some kHz, damping 0.005 to 0.05; shown by steps, or a sweep towards the frequency."""

    name = "resonance"
    title = "Resonance"
    equation = "w^2 / (s^2 + 2 z w s + w^2) on a share of the stroke"
    source = "mass on the stack's and the guide's stiffness"
    confused_with = ("delay", "lag")
    order = 30
    mode = "output"
    limit_unit = "Hz"
    limit_side = "below"
    rival_if_implausible = False
    reports_bounds = False
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
            Parameter("damping", "1", 5e-4, 0.6, sure=SURE_DAMPING),
            Parameter("share", "1", 0.005, 1.0, sure=SURE_SHARE, whole=True),
        )

    def params_at(self, theta: Sequence[float]) -> tuple[Parameter, ...]:
        """Return the parameters; the share's uncertainty includes the error of linear interpolation
        between samples, which has sinc(f dt)^2 of a smooth drive's amplitude at the mode."""
        frequency, damping, share = self.parameters
        lost = LOST * (1.0 - float(np.sinc(theta[0] / self._rate)) ** 2)
        return frequency, damping, replace(share, sure=min(max(SURE_SHARE, lost), OPEN_SHARE))

    def starts(self, data: Data, residual: Floats) -> list[tuple[float, ...]]:
        rate = 1.0 / data.period
        out: list[tuple[float, ...]] = [(f * rate, 0.1, 1.0) for f in (0.04, 0.1, 0.25)]
        for f in peaks(data, residual):
            # a start one bandwidth away would miss a lightly damped mode
            near = f * np.array([0.985, 0.995, 1.0, 1.005, 1.015])
            out += [(float(g), z, 1.0) for g in near for z in (0.01, 0.04)]
            # a mode above half the sampling rate appears at its mirror frequency
            out += [(f, 0.1, 1.0), (rate - f, 0.01, 1.0), (rate + f, 0.01, 1.0)]
        return out

    def likelier_equivalents(self, theta: Sequence[float]) -> list[tuple[float, ...]]:
        f, z, share = theta
        mirrored = abs(f - self._rate * round(f / self._rate))
        low, damping, _ = self.parameters
        if f < 0.5 * self._rate or mirrored < low.low:
            return []
        # the same decay time: damping times frequency is the same
        return [(mirrored, min(z * f / mirrored, damping.high), share)]

    def plausibility_weight(self, theta: Sequence[float], amplitudes: Floats) -> float:
        # a mode and its mirror look the same in the samples: the mirror must fit clearly better
        return 1.0 if theta[0] < 0.5 * self._rate else MIRRORED

    def can_count_when_small(self, theta: Sequence[float]) -> bool:
        return theta[1] < RINGS_LONG

    def free_oscillation(self, theta: Sequence[float]) -> tuple[float, float]:
        return theta[0], 2 * np.pi * theta[0] * theta[1]

    def output(self, data: Data, x: Floats, theta: Sequence[float]) -> Floats:
        f, z, share = theta
        mode = second_order(x, 2 * np.pi * f * data.dt, z, data.starts, data.stepped)
        return (1.0 - share) * x + share * mode

    def probes(self, data: Data) -> list[Probe]:
        if self.key != "resonance":
            return []
        low, high = np.log10(0.01 / data.period), np.log10(HIGHEST_EXCLUDED / data.period)
        frequencies = np.logspace(high, low, 13)  # higher is weaker
        reach = RINGS_WITHIN * fastest_hz(data.u, data.part, data.period)
        return [Probe(float(f), (float(f), 0.02, 1.0)) for f in frequencies if f < reach]

    def blocks(self, theta: Sequence[float], amplitudes: Floats, data: Data) -> tuple[Block, ...]:
        f, z, share = (float(v) for v in theta)
        own = {"frequency_hz": f, "damping": z, "share": share, **held_key(data)}
        return (Block("resonance", "stage", dict(own)),)

    def describe(self, values: Mapping[str, tuple[float, str]]) -> str:
        f, z = values["frequency_hz"][0], values["damping"][0]
        return (
            f"The stage rings at {f:.4g} Hz (damping {z:.2g}) after every fast move; shape the "
            "moves, add damping, or use a notch filter at this frequency."
        )

    def implausible(self, theta: Sequence[float], amplitudes: Floats, data: Data) -> str:
        frequency, damping, _ = theta
        mirrored = abs(frequency - self._rate * round(frequency / self._rate))
        if damping * frequency > NO_RING * mirrored:
            return "its ringing is not visible in the samples: a lag or a delay has the same effect"
        if frequency > 0.5 * self._rate:
            fastest = fastest_hz(data.u, data.part, data.period)
            if mirrored < RINGS_WITHIN * fastest < 0.5 * self._rate:
                return "its alias lies among a smooth drive's frequencies: nothing excites it"
        return ""


def _variants(s: Scales) -> list[Block]:
    f = 1.0 / s.period_s
    return [
        Block("resonance", "stage", {"frequency_hz": k * f, "damping": z, "share": 1.0})
        for k, z in ((0.2, 0.02), (0.05, 0.02), (0.1, 0.02), (0.3, 0.02), (0.1, 0.2), (0.2, 0.3))
    ]


PHYSICS = Physics(
    name="resonance",
    kinds=(KIND,),
    candidates=lambda data: [Resonance(data, k) for k in range(3)],
    specimens={"resonance": Specimen(_variants)},
)
