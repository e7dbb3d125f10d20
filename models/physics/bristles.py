"""Friction that decreases with the speed: bristles in the guide, which bend and then slide.

    y = x - a z - b v,    dz = (dx - |dx| z / g) / l,    g = 1 + e exp(-(v / v_s)^2),    v = dx/dt

This is the LuGre model (Canudas de Wit, Olsson, Astrom, Lischinsky, IEEE Trans. Autom. Control 40,
1995, 419). x is the drive times a gain, the stroke per drive range: the friction reverses where the
drive reverses. The displacement cannot be used instead. A base that fits hysteresis of any shape
has absorbed the part of the friction that does not depend on speed, and its displacement may run
back at a turn.

The candidate is recognised by its dependence on the speed: presliding alone is a rate-independent
memory and remains in the base. The viscous part b v grows with the speed while the bristles' part
decreases. The fit includes it: without it, a guide with much of both seems to push at low speed. By
itself it is a lag, and is not reported as friction. How much of the friction the base absorbs
depends on the friction law, which is unknown. Therefore no size of friction is excluded.
"""

import math
from collections.abc import Mapping, Sequence

import numpy as np
from numba import njit

from dehyst.models.model import Block
from dehyst.models.physics.address import Kernel, fields, record
from dehyst.models.physics.candidate import Candidate, Context, Parameter, format_length
from dehyst.models.physics.entry import Physics, Scales, Specimen
from dehyst.models.physics.kind import Kind, Param, Subtracted, head_record
from dehyst.models.signals.error_size import rms
from dehyst.models.signals.joined import Bools, Data, Floats

PACKED = fields("length", "stribeck", "excess", "sliding", "gain", "viscous", "fastest")
STATE = fields("x", "z")  # previous path, bristles
EXCESS = 0.5
"""e, the additional friction at rest relative to that at high speed: 1.5 to 1 in the paper's table.
Recordings determine only the product a e: friction that does not depend on speed cannot be
distinguished from the hysteresis."""
ANY_SPEED = 1e12
LEADS = 0.2
"""The viscous part may be negative, owing to noise, by up to this fraction of the speed-dependent
bristle part, rms."""
LAG_ALONE = 0.5
"""The speed-dependent bristle part is at least this fraction of the viscous part, rms; with less
the effect is a lag."""


@njit(cache=True, nogil=True)
def bend(z: float, dx: float, v: float, length: float, stribeck: float, excess: float) -> float:
    """Return the bristle state after a move by dx at the speed v, exact for a constant speed."""
    if dx == 0.0:
        return z
    g = 1.0 + excess * math.exp(-((v / stribeck) ** 2))
    end = g if dx > 0.0 else -g
    return end + (z - end) * math.exp(-abs(dx) / (length * g))


@Kernel
def step(
    p_at: int, n_p: int, s_at: int, n_s: int, x: float, t: float, dt: float, ch: float
) -> float:
    """Forward; x: drive."""
    p, s = record(p_at, PACKED), record(s_at, STATE)
    dx = p.gain * x - s.x
    v = dx / dt if dt > 0.0 else 0.0
    s.z = bend(s.z, dx, v, p.length, p.stribeck, p.excess)
    s.x = p.gain * x
    return -p.sliding * s.z - p.viscous * min(max(v, -p.fastest), p.fastest)


def _start(p: Floats, s: Floats, x: float) -> None:
    state = head_record(s, STATE)
    state["x"], state["z"] = head_record(p, PACKED)["gain"] * x, 0.0


KIND = Kind(
    name="bristles",
    says="friction in the guide that falls with the speed",
    places=("stage",),
    params=(
        Param("length_{y}", "length", "", 1e-9, 1e9, "path before it slides"),
        Param("stribeck_{y}_per_s", "stribeck", "/s", 1e-9, 1e12, "speed at which it fades"),
        Param("excess", "excess", "", 0.0, 1e3, "more at rest, part of that at high speed"),
        Param("sliding_{y}", "sliding", "", -1e9, 1e9, "friction at high speed"),
        Param("gain_{y}_per_{u}", "gain", "", -1e9, 1e9, "path by the drive"),
        Param("viscous_s", "viscous", "s", -1e3, 1e3, "by the speed", default=(0.0,)),
        Param(
            "fastest_{y}_per_s",
            "fastest",
            "/s",
            0.0,
            ANY_SPEED,
            "fastest speed recorded: above it the viscous part stays as it is",
            default=(ANY_SPEED,),
        ),
    ),
    packed=PACKED,
    state=STATE,
    step=step,
    start=_start,
    inverse=Subtracted(),
)


class Friction(Candidate):
    """Additive -a z - b v, with z and v of the drive's path. Typical: 50 to 200 nm; shown by small
    reversals at several speeds."""

    name = key = "friction"
    title = "Friction in the guide"
    equation = "y = x - a z - b v, dz = (dx - |dx| z / g) / l, g = 1 + e exp(-(v / v_s)^2)"
    source = "LuGre, Canudas de Wit et al., IEEE Trans. Autom. Control 40 (1995)"
    confused_with = ("rate", "lag")
    order = 45
    static = True
    contains = ("delay", "lag", "slew")  # the viscous part acts like one of these
    rival_if_implausible = False

    def __init__(self, data: Data) -> None:
        stroke = self._stroke = float(np.ptp(data.y))
        self._gain = stroke / data.span
        self._fastest = self._gain * float(np.abs(_speeds(data)).max())
        fastest = max(self._fastest, 0.2 * stroke)
        self.parameters = (
            Parameter("length_um", data.unit, 5e-4 * stroke, 0.3 * stroke),
            Parameter("stribeck_um_per_s", f"{data.unit}/s", 0.02 * stroke, fastest),
        )

    def starts(self, data: Data, residual: Floats) -> list[tuple[float, ...]]:
        lengths, speeds = (0.004, 0.01, 0.03), (0.4, 1.6, 6.0, 24.0)
        most = 0.98 * self.parameters[1].high
        return [
            (a * self._stroke, b * self._stroke)
            for a in lengths
            for b in speeds
            if b * self._stroke < most
        ]

    def columns(self, data: Data, context: Context, theta: Sequence[float]) -> Floats:
        x = self._gain * context.v
        return _columns(x, data.dt, data.starts, theta[0], theta[1], EXCESS)

    def plausibility_weight(self, theta: Sequence[float], amplitudes: Floats) -> float:
        return 1.0 if amplitudes[0] >= 0.0 else 0.0  # friction never pushes

    def values(self, theta: Sequence[float], amplitudes: Floats) -> dict[str, tuple[float, str]]:
        extra = (EXCESS * float(amplitudes[0]), self.parameters[0].unit)
        return {**super().values(theta, amplitudes), "extra_um": extra}

    def blocks(self, theta: Sequence[float], amplitudes: Floats, data: Data) -> tuple[Block, ...]:
        params: dict[str, float | tuple[float, ...]] = {
            f"length_{data.unit}": float(theta[0]),
            f"stribeck_{data.unit}_per_s": float(theta[1]),
            "excess": EXCESS,
            f"sliding_{data.unit}": float(amplitudes[0]),
            f"gain_{data.unit}_per_{data.drive_unit}": self._gain,
            "viscous_s": float(amplitudes[1]),
            f"fastest_{data.unit}_per_s": self._fastest,
        }
        return (Block("bristles", "stage", params),)

    def describe(self, values: Mapping[str, tuple[float, str]]) -> str:
        return (
            "The guide has friction: after each reversal the stage lags by "
            f"{format_length(values['extra_um'])} more at low speed than at high speed; check the "
            "guide and its preload."
        )

    def implausible(self, theta: Sequence[float], amplitudes: Floats, data: Data) -> str:
        fades = EXCESS * amplitudes[0]
        if fades < 0:
            return "friction that pushes"
        grows = amplitudes[1] * self._gain * rms(_speeds(data))
        if grows < -LEADS * fades:
            return "friction that leads"
        return "a lag by itself" if fades < LAG_ALONE * grows else ""


def _speeds(data: Data) -> Floats:
    """Return the (n,) speeds of the drive at all samples that follow another [drive unit / s]."""
    follows = ~data.starts[1:]
    return np.asarray((np.diff(data.u) / data.dt[1:])[follows])


@njit(cache=True, nogil=True)
def _columns(
    x: Floats, dt: Floats, starts: Bools, length: float, stribeck: float, excess: float
) -> Floats:
    """Return (N, 2) columns: -z, -v."""
    out = np.zeros((x.size, 2))
    z = 0.0
    for t in range(x.size):
        if starts[t]:
            z = 0.0
            continue
        dx = x[t] - x[t - 1]
        z = bend(z, dx, dx / dt[t], length, stribeck, excess)
        out[t, 0], out[t, 1] = -z, -dx / dt[t]
    return out


def _variants(s: Scales) -> list[Block]:
    y, stroke = s.unit, s.stroke
    sizes = {f"sliding_{y}": 0.01 * stroke, "excess": EXCESS}
    gain = {f"gain_{y}_per_{s.drive_unit}": stroke / s.span}
    return [
        Block(
            "bristles",
            "stage",
            {f"length_{y}": k * stroke, f"stribeck_{y}_per_s": 2.0 * stroke, **sizes, **gain},
        )
        for k in (0.01, 0.003, 0.03)
    ]


PHYSICS = Physics(
    name="friction",
    kinds=(KIND,),
    candidates=lambda data: [Friction(data)],
    specimens={"friction": Specimen(_variants, in_base=True)},
)
