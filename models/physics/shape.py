"""Hysteresis whose shape the base does not have. Three kinds of block act parallel to it: they read
the drive u that reaches the hysteresis, and add to its displacement.

    shape       y = sum_i e1_i H_i + e2_i H_i^2 + ... + e5_i H_i^5
    memory      y = p_4 v^4 + p_5 v^5 + sum_j Z_j (e1_j + e2_j v + e3_j v^2 + e4_j Z_j + e5_j Z_j^2)
                dZ_j/dv = (sign(dv) - Z_j) / l_j
    one_sided   y = a max(u - H, 0)^2 + b max(H - u, 0)^2

with v = (u - center) / scale, H_i the play of width r_i / scale on v, and H the play of width r on
u - center. The Z_j are Dahl operators (P. Dahl, "Solid friction damping of mechanical vibrations",
1976, exponent 1), exact for a drive that is linear between samples. They represent loops of the
Duhem and Bouc-Wen type, which sums of plays cannot. All start de-energised.

The base of the diagnosis contains the first two. The candidate here recognises what it does not
contain, a one-sided dead band.
"""

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from dehyst.models.model import Block
from dehyst.models.physics.address import Kernel, behind, fields, numbers, record
from dehyst.models.physics.candidate import Candidate, Context, Parameter, Probe
from dehyst.models.physics.entry import Physics, Scales, Specimen
from dehyst.models.physics.kind import Kind, Param, Subtracted, Values, head_record
from dehyst.models.signals.filters import plays
from dehyst.models.signals.joined import Data, Floats

SHAPE = fields("center", "scale")  # followed by r / scale, e1 ... e5 of n operators
MEMORY = fields("center", "scale", "power_4", "power_5")  # followed by l / scale, e1 ... e5
MEMORY_STATE = fields("before")  # previous v; followed by (n,) operators
ONE_SIDED = fields("threshold", "rising", "falling", "center")
ONE_SIDED_STATE = fields("h")
TERMS = ("of Z", "of Z v", "of Z v^2", "of Z^2", "of Z^3")
WEIGHTS = 5  # rows of weights of a kind


@Kernel
def step_shape(
    p_at: int, n_p: int, s_at: int, n_s: int, x: float, t: float, dt: float, ch: float
) -> float:
    """Forward; x: drive; state: (n,) plays."""
    p, rows, h = record(p_at, SHAPE), behind(p_at, n_p, 2), numbers(s_at, n_s)
    n = h.size
    v = (x - p.center) / p.scale
    y = 0.0
    for i in range(n):
        a = max(v - rows[i], min(v + rows[i], h[i]))
        h[i] = a
        high = rows[3 * n + i] + a * (rows[4 * n + i] + a * rows[5 * n + i])
        y += a * (rows[n + i] + a * (rows[2 * n + i] + a * high))
    return y


@Kernel
def step_memory(
    p_at: int, n_p: int, s_at: int, n_s: int, x: float, t: float, dt: float, ch: float
) -> float:
    """Forward; x: drive."""
    p, rows = record(p_at, MEMORY), behind(p_at, n_p, 4)
    s, z = record(s_at, MEMORY_STATE), behind(s_at, n_s, 1)
    n = z.size
    v = (x - p.center) / p.scale
    dv = v - s.before
    s.before = v
    square = v * v
    y = square * square * (p.power_4 + p.power_5 * v)
    for j in range(n):
        a = z[j]
        if dv != 0.0:
            sign = 1.0 if dv > 0.0 else -1.0
            a = sign + (a - sign) * math.exp(-abs(dv) / rows[j])
            z[j] = a
        even = rows[n + j] + v * (rows[2 * n + j] + v * rows[3 * n + j])
        y += a * (even + a * (rows[4 * n + j] + a * rows[5 * n + j]))
    return y


@Kernel
def step_one_sided(
    p_at: int, n_p: int, s_at: int, n_s: int, x: float, t: float, dt: float, ch: float
) -> float:
    """Forward; x: drive."""
    p, s = record(p_at, ONE_SIDED), record(s_at, ONE_SIDED_STATE)
    v = x - p.center
    s.h = max(v - p.threshold, min(v + p.threshold, s.h))
    ahead = v - s.h
    return (p.rising if ahead > 0.0 else p.falling) * ahead * ahead


def _packed(lengths: str, *head: str) -> Callable[[Values, float], Floats]:
    """Return a pack function: scalars, then the operators' scaled lengths, then their weights."""

    def pack(values: Values, dt: float) -> Floats:
        r = values[lengths]
        rows = [np.broadcast_to(values[f"weights_{k}"], r.shape) for k in range(1, WEIGHTS + 1)]
        return np.concatenate([[values[k][0] for k in head], r / values["scale"][0], *rows])

    return pack


def _checked(lengths: str) -> Callable[[Values], str]:
    def check(values: Values) -> str:
        for k in range(1, WEIGHTS + 1):
            if values[f"weights_{k}"].size not in (1, values[lengths].size):
                return f"weights_{k}: as many as {lengths} are needed"
        return ""

    return check


def _start_memory(p: Floats, s: Floats, x: float) -> None:
    s[:] = 0.0
    packed = head_record(p, MEMORY)
    head_record(s, MEMORY_STATE)["before"] = (x - packed["center"]) / packed["scale"]


def _weights(name: str, meaning: str, default: tuple[float, ...] | None = None) -> Param:
    return Param(name, name, "", -1e9, 1e9, meaning, many=True, default=default)


SCALE = Param("scale_{u}", "scale", "", 1e-9, 1e9, "drive that counts as 1")
CENTER = Param("center_{u}", "center", "", -1e9, 1e9, "drive that counts as 0", default=(0.0,))
KINDS = (
    Kind(
        name="shape",
        says="hysteresis of another shape than the base",
        places=("stage",),
        params=(
            Param("thresholds_{u}", "thresholds", "", 0.0, 1e9, "thresholds", many=True),
            _weights("weights_1", "of H", (0.0,)),
            _weights("weights_2", "of H^2"),
            _weights("weights_3", "of H^3"),
            _weights("weights_4", "of H^4", (0.0,)),
            _weights("weights_5", "of H^5", (0.0,)),
            SCALE,
            CENTER,
        ),
        packed=SHAPE,
        step=step_shape,
        pack=_packed("thresholds", "center", "scale"),
        size=lambda p, dt: (p.size - 2) // 6,
        inverse=Subtracted(),
        check=_checked("thresholds"),
    ),
    Kind(
        name="memory",
        says="hysteresis of another shape than the base, with bent loops",
        places=("stage",),
        params=(
            Param("lengths_{u}", "lengths", "", 1e-9, 1e9, "drive in which Z follows", many=True),
            *(_weights(f"weights_{k + 1}", what) for k, what in enumerate(TERMS)),
            Param("power_4", "power_4", "", -1e9, 1e9, "of v^4", default=(0.0,)),
            Param("power_5", "power_5", "", -1e9, 1e9, "of v^5", default=(0.0,)),
            SCALE,
            CENTER,
        ),
        packed=MEMORY,
        state=MEMORY_STATE,
        step=step_memory,
        pack=_packed("lengths", "center", "scale", "power_4", "power_5"),
        size=lambda p, dt: 1 + (p.size - 4) // 6,
        start=_start_memory,
        inverse=Subtracted(),
        check=_checked("lengths"),
    ),
    Kind(
        name="one_sided",
        says="hysteresis that differs between rising and falling",
        places=("stage",),
        params=(
            Param("threshold_{u}", "threshold", "", 0.0, 1e9, "width of the play"),
            Param("rising_{y}_per_{u}2", "rising", "", -1e9, 1e9, "of the square while rising"),
            Param("falling_{y}_per_{u}2", "falling", "", -1e9, 1e9, "of the square while falling"),
            CENTER,
        ),
        packed=ONE_SIDED,
        state=ONE_SIDED_STATE,
        step=step_one_sided,
        inverse=Subtracted(),
    ),
)


@dataclass(frozen=True)
class DriveScale:
    """The drive that counts as 0, the change of drive that counts as 1, and their unit."""

    center: float
    scale: float
    unit: str

    def params(self) -> dict[str, float | tuple[float, ...]]:
        """Return the keys of a block."""
        return {f"scale_{self.unit}": self.scale, f"center_{self.unit}": self.center}


def curved_plays(thresholds: Floats, weights: Floats, scale: DriveScale) -> Block:
    """Return the block of plays (n,) with weights (5, n) of H ... H^5."""
    return Block("shape", "stage", _listed("thresholds", thresholds, weights, scale))


def bent_loops(lengths: Floats, weights: Floats, powers: Floats, scale: DriveScale) -> Block:
    """Return the block of Dahl operators (n,) with weights (5, n), see TERMS, and powers (2,) of
    v^4 and v^5."""
    params = _listed("lengths", lengths, weights, scale)
    params |= {"power_4": float(powers[0]), "power_5": float(powers[1])}
    return Block("memory", "stage", params)


def _listed(
    name: str, lengths: Floats, weights: Floats, scale: DriveScale
) -> dict[str, float | tuple[float, ...]]:
    rows = {f"weights_{k + 1}": tuple(row.tolist()) for k, row in enumerate(weights)}
    return {f"{name}_{scale.unit}": tuple(lengths.tolist()), **rows, **scale.params()}


class Asymmetry(Candidate):
    """y + a max(u - H_r, 0)^2 + b max(H_r - u, 0)^2. Typical: one branch of the loop steeper than
    the other; shown by full loops and small loops about several levels."""

    name = key = "asymmetry"
    title = "Asymmetric loop"
    equation = "y = f(u) + a max(u - H_r, 0)^2 + b max(H_r - u, 0)^2"
    source = "one-sided dead zones, after Kuhnen 2003; bias of unipolar stacks"
    confused_with = ("sensor", "friction", "clip")
    order = 64
    static = True

    def __init__(self, data: Data) -> None:
        self.limit_unit = f"{data.unit}/{data.drive_unit}^2"
        self._span = data.span
        self._low = data.u_min
        self.parameters = (
            Parameter(
                f"threshold_{data.drive_unit}", data.drive_unit, 3e-3 * data.span, 0.45 * data.span
            ),
        )

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

    def describe(self, values: Mapping[str, tuple[float, str]]) -> str:
        return (
            "The rising and falling branches differ by more than symmetric hysteresis explains; "
            "the identified loop needs its asymmetric terms. A nonlinear sensor or friction in the "
            "guide can look the same."
        )


def _variants(s: Scales) -> list[Block]:
    """Return loops that bend over on one side: the square of a Dahl operator."""
    half, weights = 0.5 * s.span, np.zeros((WEIGHTS, 2))
    weights[TERMS.index("of Z^2")] = 0.005 * s.stroke
    scale = DriveScale(s.drive_min + half, half, s.drive_unit)
    return [
        bent_loops(np.array([k * half, 2 * k * half]), weights, np.zeros(2), scale)
        for k in (0.3, 0.1, 1.0)
    ]


def _curved(s: Scales) -> list[Block]:
    """Return plays whose envelopes bend over towards the upper end."""
    half, weights = 0.5 * s.span, np.zeros((WEIGHTS, 2))
    weights[1], weights[2] = 0.01 * s.stroke, -0.005 * s.stroke
    scale = DriveScale(s.drive_min, half, s.drive_unit)
    return [
        curved_plays(np.array([k * s.span, 2 * k * s.span]), weights, scale)
        for k in (0.05, 0.02, 0.15)
    ]


PHYSICS = Physics(
    name="asymmetry",
    kinds=KINDS,
    candidates=lambda data: [Asymmetry(data)],
    looks={"centre": 2, "branches": 1, "presliding": 2, "class": 1},
    specimens={
        "asymmetry": Specimen(_variants, in_base=True),
        "shape": Specimen(_curved, in_base=True),
    },
    distinguished_by={
        "sensor": "repeated triangles over the full range, and a calibration of the sensor"
    },
)
