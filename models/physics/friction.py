"""Friction in the guide: y = x - (a + b exp(-(v / v_s)^2)) z, v = dx/dt,
dz/dx = (1 - z sign v)^n sign v / l.

The presliding state z of Dahl (1976) with the speed dependence of Stribeck, as in the LuGre
model (Canudas de Wit, Olsson, Astrom, Lischinsky, IEEE Trans. Autom. Control 40, 1995, 419). The
exponent n is 1 (z follows a curve) or 0 (z rises linearly, then slides). With n = 0 and a = l the
stage rests after each turn until x has moved by 2 l: a play.

This is a rate-independent memory of the displacement, which the base of a diagnosis absorbs. It is
found as a change from a model that was right before. Friction that decreases with the speed is
reported by `bristles`; n = 1 and a part b occur in older model files.
"""

import math
from collections.abc import Mapping, Sequence

import numpy as np
from numba import njit

from dehyst.models.model import Block
from dehyst.models.physics.address import Kernel, fields, record
from dehyst.models.physics.candidate import Candidate, Context, Parameter, format_length
from dehyst.models.physics.entry import Physics, Scales, Specimen
from dehyst.models.physics.kind import Kind, Param, Solved, Values, head_record
from dehyst.models.signals.filters import plays
from dehyst.models.signals.joined import Data, Floats

SETTLED = 1e-6  # tolerance of the inverse, relative to the friction
LEAST_SLOPE = 0.05
"""Smallest slope dy/dx while it sticks: a play with slope 0 cannot be inverted (the stage then lags
at the turn by up to twice this fraction of the friction)."""
MOST_OF_LENGTH = 1.3  # largest a / l: beyond 1 the stage would move backwards while it sticks
PACKED = fields("length", "stribeck", "sliding", "extra", "exponent")
STATE = fields("x", "z")  # previous input, presliding


@njit(cache=True, nogil=True)
def _preslid(length: float, exponent: float, x_before: float, z: float, x: float) -> float:
    """Return the presliding state after a move to x."""
    dx = x - x_before
    if exponent == 0.0:
        return max(-1.0, min(1.0, z + dx / length))
    if dx != 0.0:
        sign = 1.0 if dx > 0.0 else -1.0
        z = sign + (z - sign) * math.exp(-abs(dx) / length)
    return z


@njit(cache=True, nogil=True)
def _output(p_at: int, s_at: int, x: float, dt: float) -> float:
    """Return the output for the next input x; the state is not modified."""
    p, s = record(p_at, PACKED), record(s_at, STATE)
    z = _preslid(p.length, p.exponent, s.x, s.z, x)
    speed = (x - s.x) / dt / p.stribeck if dt > 0.0 else 0.0
    return x - (p.sliding + p.extra * math.exp(-speed * speed)) * z


@njit(cache=True, nogil=True)
def _move(p_at: int, s_at: int, x: float) -> None:
    p, s = record(p_at, PACKED), record(s_at, STATE)
    s.z = _preslid(p.length, p.exponent, s.x, s.z, x)
    s.x = x


@Kernel
def step(
    p_at: int, n_p: int, s_at: int, n_s: int, x: float, t: float, dt: float, ch: float
) -> float:
    """Forward."""
    y = _output(p_at, s_at, x, dt)
    _move(p_at, s_at, x)
    return y


@Kernel
def solve(
    p_at: int, n_p: int, s_at: int, n_s: int, y: float, t: float, dt: float, ch: float
) -> float:
    """Inverse, by regula falsi (Illinois). A solution always exists within the largest friction
    of y."""
    p = record(p_at, PACKED)
    most = abs(p.sliding) + abs(p.extra)
    low, high = y - most, y + most
    at_low, at_high = _output(p_at, s_at, low, dt) - y, _output(p_at, s_at, high, dt) - y
    side, x = 0, y
    for _ in range(60):
        if not at_low < at_high:
            break
        x = (low * at_high - high * at_low) / (at_high - at_low)
        e = _output(p_at, s_at, x, dt) - y
        if abs(e) <= SETTLED * most:
            break
        if e > 0.0:
            high, at_high = x, e
            at_low *= 0.5 if side > 0 else 1.0
            side = 1
        else:
            low, at_low = x, e
            at_high *= 0.5 if side < 0 else 1.0
            side = -1
    _move(p_at, s_at, x)
    return x


def _start(p: Floats, s: Floats, x: float) -> None:
    state = head_record(s, STATE)
    state["x"], state["z"] = x, 0.0


def _check(values: Values) -> str:
    return "" if values["exponent"][0] in (0.0, 1.0) else "exponent: must be 0 or 1"


KIND = Kind(
    name="friction",
    says="friction in the guide",
    places=("stage",),
    params=(
        Param("length_{y}", "length", "", 1e-9, 1e9, "displacement before it slides"),
        Param("stribeck_{y}_per_s", "stribeck", "/s", 1e-9, 1e12, "speed at which it fades"),
        Param("sliding_{y}", "sliding", "", -1e9, 1e9, "at high speed"),
        Param("extra_{y}", "extra", "", -1e9, 1e9, "more at low speed"),
        Param("exponent", "exponent", "", 0.0, 1.0, "1: it bends, 0: straight", default=(1.0,)),
    ),
    packed=PACKED,
    state=STATE,
    step=step,
    start=_start,
    inverse=Solved(solve, memory=True),
    check=_check,
)


class DryFriction(Candidate):
    """x - a z, dz/dx = 1 / l within -1..1: z rises linearly, then slides. Typical: 50 to 400 nm;
    shown by reversals, about a model that was right before."""

    name = "friction"
    key = "friction-dry"
    title = "Friction in the guide"
    equation = "y = x - a z, dz/dx = 1 / l, -1 <= z <= 1"
    source = "Coulomb friction on an elastic contact; Dahl 1976, exponent 0"
    confused_with = ("shape", "asymmetry")
    order = 45
    static = True

    def __init__(self, data: Data) -> None:
        stroke = self._stroke = float(np.ptp(data.y))
        self.parameters = (Parameter("length_um", data.unit, 1e-3 * stroke, 0.3 * stroke),)

    def starts(self, data: Data, residual: Floats) -> list[tuple[float, ...]]:
        return [(part * self._stroke,) for part in (0.004, 0.01, 0.025, 0.06)]

    def columns(self, data: Data, context: Context, theta: Sequence[float]) -> Floats:
        x, length = context.output, np.array([theta[0]])
        return np.asarray((plays(length, x, data.starts) - x[:, None]) / theta[0])

    def values(self, theta: Sequence[float], amplitudes: Floats) -> dict[str, tuple[float, str]]:
        out = super().values(theta, amplitudes)
        out["sliding_um"] = (float(amplitudes[0]), self.parameters[0].unit)
        return out

    def blocks(self, theta: Sequence[float], amplitudes: Floats, data: Data) -> tuple[Block, ...]:
        sliding = float(amplitudes[0])
        params: dict[str, float | tuple[float, ...]] = {
            f"length_{data.unit}": max(float(theta[0]), sliding / (1.0 - LEAST_SLOPE)),
            f"stribeck_{data.unit}_per_s": self._stroke,
            f"sliding_{data.unit}": sliding,
            f"extra_{data.unit}": 0.0,
            "exponent": 0.0,
        }
        return (Block("friction", "stage", params),)

    def describe(self, values: Mapping[str, tuple[float, str]]) -> str:
        return (
            f"The guide has friction: after each reversal the stage lags by up to "
            f"{format_length(values['sliding_um'])} in either direction; check the guide and its "
            "preload."
        )

    def implausible(self, theta: Sequence[float], amplitudes: Floats, data: Data) -> str:
        if amplitudes[0] < 0:
            return "friction that pushes"
        return "it would run back" if amplitudes[0] > MOST_OF_LENGTH * theta[0] else ""


def _variants(s: Scales) -> list[Block]:
    """Return friction of a hundredth of the stroke."""
    y, size = s.unit, 0.01 * s.stroke
    params = {f"stribeck_{y}_per_s": s.stroke, f"sliding_{y}": size, f"extra_{y}": 0.0}
    return [
        Block("friction", "stage", {f"length_{y}": k * size, **params, "exponent": 0.0})
        for k in (1.1, 2.0)
    ]


PHYSICS = Physics(
    name="friction",
    kinds=(KIND,),
    candidates=lambda data: [],
    changes=lambda data: [DryFriction(data)],
    looks={"branches": 3, "presliding": 1, "class": 2},
    specimens={"dry-friction": Specimen(_variants, in_base=True)},
)
