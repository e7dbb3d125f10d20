"""The drive is limited to a range: y = min(max(x, low), high)."""

from collections.abc import Mapping, Sequence

import numpy as np

from dehyst.models.model import Block
from dehyst.models.physics.address import Kernel, fields, record
from dehyst.models.physics.candidate import Candidate, Parameter, Probe
from dehyst.models.physics.entry import Physics, Scales, Specimen
from dehyst.models.physics.kind import Kind, Limited, Param, Values
from dehyst.models.signals.joined import Data, Floats
from dehyst.models.units import spell_unit

PACKED = fields("min", "max")


@Kernel
def step(
    p_at: int, n_p: int, s_at: int, n_s: int, x: float, t: float, dt: float, ch: float
) -> float:
    """Forward."""
    p = record(p_at, PACKED)
    return min(max(x, p.min), p.max)


def _check(values: Values) -> str:
    return "" if values["min"][0] < values["max"][0] else "min must be below max"


KIND = Kind(
    name="clip",
    says="a clipped drive",
    places=("drive",),
    params=(
        Param("min_{u}", "min", "", -1e9, 1e9, "lower end"),
        Param("max_{u}", "max", "", -1e9, 1e9, "upper end"),
    ),
    packed=PACKED,
    step=step,
    inverse=Limited(lambda p: (p[0], p[1], np.inf)),
    check=_check,
)


DEEPEST = (0.35, 0.6)  # largest fraction of the range cut off at the lower and the upper end
REACHED = 0.002  # smallest fraction of the range that a limit cuts off
STANDS = 0.5  # largest travel per drive beyond a limit, of that elsewhere: a stage gives about 0
# there, and 1 where a limit that is none only bends the loop


class Clip(Candidate):
    """v = min(max(u, lowest), highest). Typical: a few per cent of the range at one end; shown by
    moves over the full range."""

    name = key = "clip"
    title = "Clipped drive"
    equation = "v = min(max(u, v_min), v_max)"
    source = "supply rails or a set limit of the amplifier"
    confused_with = ("asymmetry", "sensor")
    order = 2
    static = True
    minima = 4
    place = "drive"
    mode = "drive"
    limit_side = "below"
    reports_bounds = False

    def __init__(self, data: Data) -> None:
        self.limit_unit = data.drive_unit
        low, high = data.u_min, data.u_min + data.span
        self._low, self._high, span = low, high, data.span
        self._data = data
        beyond, (up, down) = 0.05 * span, (DEEPEST[0] * span, DEEPEST[1] * span)
        self.parameters = (
            Parameter("min_v", data.drive_unit, low - beyond, low + up, False),
            Parameter("max_v", data.drive_unit, high - down, high + beyond, False),
        )

    def starts(self, data: Data, residual: Floats) -> list[tuple[float, ...]]:
        low, high, span = self._low, self._high, self._high - self._low
        out = [(low, high - f * span) for f in (0.01, 0.03, *np.arange(0.08, 0.55, 0.06))]
        out += [(low + f * span, high) for f in (0.01, 0.03, 0.05, 0.07, 0.09, 0.15)]
        out += [(low + f * span, high - f * span) for f in (0.02, 0.06)]
        return [(float(a), float(b)) for a, b in out]

    def drive(self, data: Data, v: Floats, theta: Sequence[float]) -> Floats:
        return np.clip(v, theta[0], theta[1])

    def values(self, theta: Sequence[float], amplitudes: Floats) -> dict[str, tuple[float, str]]:
        out = {}
        unit = self.parameters[0].unit
        low, high = self._ends(theta)
        if low > self._low:
            out["min_v"] = (low, unit)
        if high < self._high:
            out["max_v"] = (high, unit)
        return out

    def _ends(self, theta: Sequence[float]) -> tuple[float, float]:
        """Return both limits; one that is none lies far outside: one that is hardly reached, or
        beyond which the reading follows the drive, while it stands still beyond the other."""
        span = self._high - self._low
        low, high = float(theta[0]), float(theta[1])
        is_low, is_high = low > self._low + REACHED * span, high < self._high - REACHED * span
        if is_low and is_high:
            below, above = self._stands_beyond(low, -1.0), self._stands_beyond(high, 1.0)
            if below != above:
                is_low, is_high = below, above
        return low if is_low else self._low - span, high if is_high else self._high + span

    def _stands_beyond(self, limit: float, way: float) -> bool:
        """Return whether the reading stands still while the drive moves away from its range beyond
        a limit. Moves back do not count: after a turn a hysteresis may stand still. way: 1 above,
        -1 below."""
        u = way * self._data.u
        du, dy = np.diff(u), np.diff(self._data.y)
        outward = (du > 0.0) & ~self._data.starts[1:]
        beyond = outward & (u[:-1] > way * limit)
        if not beyond.any():
            return False
        there, elsewhere = (dy[k].sum() / du[k].sum() for k in (beyond, outward & ~beyond))
        return bool(abs(there) < STANDS * abs(elsewhere))

    def probes(self, data: Data) -> list[Probe]:
        span = self._high - self._low
        return [
            Probe(float(self._high - d * span), (self._low, float(self._high - d * span)))
            for d in np.geomspace(REACHED, 0.35, 10)
        ]

    def blocks(self, theta: Sequence[float], amplitudes: Floats, data: Data) -> tuple[Block, ...]:
        names = (f"min_{data.drive_unit}", f"max_{data.drive_unit}")
        return (Block("clip", "drive", dict(zip(names, self._ends(theta), strict=True))),)

    def describe(self, values: Mapping[str, tuple[float, str]]) -> str:
        ends = [
            f"{word} {values[k][0]:.4g} {spell_unit(values[k][1])}"
            for k, word in (("min_v", "below"), ("max_v", "above"))
            if k in values
        ]
        return (
            f"The drive has no effect {' and '.join(ends)}: the amplifier's limit is reached. "
            "Keep the trajectory within the limit, or raise it."
        )


def _variants(s: Scales) -> list[Block]:
    low, span, u = s.drive_min, s.span, s.drive_unit
    return [
        Block("clip", "drive", {f"min_{u}": low + a * span, f"max_{u}": low + b * span})
        for a, b in ((-1.0, 0.9), (-1.0, 0.8), (0.05, 2.0), (0.05, 0.9))
    ]


PHYSICS = Physics(
    name="clip",
    kinds=(KIND,),
    candidates=lambda data: [Clip(data)],
    specimens={"clip": Specimen(_variants)},
)
