"""Creep: after a step, y(t) = y0 [1 + g log10(t / 0.1 s)] from tau_min to tau_max.

The operator is a sum of relaxations with time constants spaced evenly on a logarithmic scale, three
per decade, with a common gain (log-type creep; H. Jung, D.-G. Gweon, Rev. Sci. Instrum. 71, 2000):

    y = x + (g / 3) sum_j [q_j - m_j x],   tau_j dq_j/dt + q_j = x,   m_j = 1 - exp(-0.1 s / tau_j)

(g / 3 holds for exactly three per decade; since their number is rounded, the weight is adjusted.)
Through the m_j, y0 is the output 0.1 s after a step; this time is a parameter, 0 where creep adds
to a model that has none of it. The operator is exact for an input that is linear between the
samples. In a recording under feedback, where the reading is held constant, creep is measured from
the drive (`dehyst.models.signals.holds`).
"""

import math
from collections.abc import Mapping, Sequence

import numpy as np
from numba import njit

from dehyst.models.model import Block
from dehyst.models.physics.address import Kernel, behind, fields, record
from dehyst.models.physics.candidate import Candidate, Parameter, Probe, Sighting
from dehyst.models.physics.entry import Physics, Scales, Specimen
from dehyst.models.physics.kind import SAME, Kind, Param, Solved, Values, head_record
from dehyst.models.signals.filters import add_relaxation, lag_step
from dehyst.models.signals.holds import longest_hold
from dehyst.models.signals.joined import Data, Floats

PER_DECADE = 3
REFERENCE_S = 0.1
PACKED = fields("third", "mean")  # g / 3, sum of m_j; followed by tau_1 ... tau_n
STATE = fields("x", "dt")  # previous input, dt of the decays; followed by n times q, n decays
HEAD = 2
HELD_SHORTEST_S = 0.1  # shortest relaxation of a creep that is measured from the drive
HELD_TIMES_LONGER = 3.0  # its longest relaxation, relative to the length of the hold
SURE_GAIN = 0.15
"""Relative uncertainty of the gain: a chain of relaxations reaches the law's slope sooner than
other laws of creep (tests/benchmarks/models/proof: the gain of log10(1 + t / 0.1 s) is found 4 to
14 % too low)."""


def _relaxations_of(
    gain: float, tau_min: float, tau_max: float, reference_s: float
) -> tuple[float, float, Floats]:
    """Return the weight of each relaxation, the sum of the m_j, and the time constants (n,). The
    sum of the weights is continuous where the number of relaxations changes by one."""
    decades = math.log10(tau_max / tau_min)
    n = max(1, round(PER_DECADE * decades) + 1)
    taus = np.geomspace(tau_min, tau_max, n)
    return (
        gain * (decades + 1.0 / PER_DECADE) / n,
        float(np.sum(1.0 - np.exp(-reference_s / taus))),
        taus,
    )


@njit(cache=True, nogil=True)
def _forward(p_at: int, n_p: int, s_at: int, n_s: int, x: float, dt: float) -> float:
    p, taus = record(p_at, PACKED), behind(p_at, n_p, HEAD)
    s, inner = record(s_at, STATE), behind(s_at, n_s, HEAD)
    n = taus.size
    if dt > 0.0 and abs(dt - s.dt) > SAME * dt:
        s.dt = dt
        for j in range(n):
            inner[n + j] = math.exp(-dt / taus[j])
    total = 0.0
    for j in range(n):
        if dt > 0.0:
            trail = taus[j] * (x - s.x) / dt
            inner[j] = lag_step(inner[j], s.x, x, trail, inner[n + j])
        total += inner[j]
    s.x = x
    return x + p.third * (total - p.mean * x)


@njit(cache=True, nogil=True)
def _input(p_at: int, n_p: int, s_at: int, n_s: int, y: float, dt: float) -> float:
    """Return the input for which the next output is y; the state is not modified."""
    p, taus = record(p_at, PACKED), behind(p_at, n_p, HEAD)
    s, inner = record(s_at, STATE), behind(s_at, n_s, HEAD)
    n = taus.size
    if dt <= 0.0:
        total = 0.0
        for j in range(n):
            total += inner[j]
        return (y - p.third * total) / (1.0 - p.third * p.mean)
    through, free = 1.0 - p.third * p.mean, 0.0
    for j in range(n):
        decay = inner[n + j] if abs(dt - s.dt) <= SAME * dt else math.exp(-dt / taus[j])
        share = taus[j] / dt * (1.0 - decay)
        through += p.third * (1.0 - share)
        free += p.third * ((share - decay) * s.x + decay * inner[j])
    return (y - free) / through


@Kernel
def step(
    p_at: int, n_p: int, s_at: int, n_s: int, x: float, t: float, dt: float, ch: float
) -> float:
    """Forward."""
    return _forward(p_at, n_p, s_at, n_s, x, dt)


@Kernel
def solve(
    p_at: int, n_p: int, s_at: int, n_s: int, y: float, t: float, dt: float, ch: float
) -> float:
    """Inverse."""
    x = _input(p_at, n_p, s_at, n_s, y, dt)
    _forward(p_at, n_p, s_at, n_s, x, dt)
    return x


def _pack(values: Values, dt: float) -> Floats:
    keys = ("gain", "tau_min", "tau_max", "reference")
    gain, tau_min, tau_max, reference_s = (float(values[k][0]) for k in keys)
    third, mean, taus = _relaxations_of(gain, tau_min, tau_max, reference_s)
    return np.concatenate([[third, mean], taus])


def _start(p: Floats, s: Floats, x: float) -> None:
    state = head_record(s, STATE)
    state["x"], state["dt"] = x, 0.0
    s[HEAD : p.size] = x


def _check(values: Values) -> str:
    low, high = values["tau_min"][0], values["tau_max"][0]
    return "" if low <= high else "tau_min_s must not be above tau_max_s"


KIND = Kind(
    name="creep",
    says="creep",
    places=("stage", "sensor"),
    params=(
        Param("gain_per_decade", "gain", "1/decade", -0.2, 0.5, "growth per decade of time"),
        Param("tau_min_s", "tau_min", "s", 1e-6, 1e7, "shortest time constant"),
        Param("tau_max_s", "tau_max", "s", 1e-6, 1e7, "longest time constant"),
        Param(
            "reference_s",
            "reference",
            "s",
            0.0,
            1e3,
            "time after a step at which the output is as without creep",
            default=(REFERENCE_S,),
        ),
    ),
    packed=PACKED,
    state=STATE,
    step=step,
    pack=_pack,
    size=lambda p, dt: HEAD + 2 * (p.size - HEAD),
    start=_start,
    inverse=Solved(solve, memory=True),
    check=_check,
    reach_assumes="moves of seconds (creep carries a longer hold further)",
)


class Creep(Candidate):
    """y = x + (g / 3) sum_k (low-pass_k(x) - m_k x), m_k = 1 - exp(-0.1 s / tau_k). Typical: 0.01
    to 0.02 per decade; shown by holds of a second and more at several levels."""

    name = key = "creep"
    title = "Creep"
    equation = "y(t) = y0 [1 + g log10(t / t0)] after a step, as a sum of relaxations"
    source = "Jung and Gweon, Rev. Sci. Instrum. 71 (2000) 1896; Kelvin-Voigt chains"
    confused_with = ("drift", "lag")
    order = 20
    mode = "output"
    lasting = True
    limit_unit = "1/decade"
    size_index = 0
    reference_s = REFERENCE_S

    def __init__(self, data: Data) -> None:
        longest = max(float(data.t.max() - data.t.min()), 50 * data.period)
        self.parameters = (
            Parameter("gain_per_decade", "1/decade", 1e-4, 0.3, sure=SURE_GAIN),
            Parameter("tau_min_s", "s", 8 * data.period, 0.2 * longest),
            Parameter("tau_max_s", "s", 0.4 * longest, 10.0 * longest),
        )
        self._longest = longest

    def starts(self, data: Data, residual: Floats) -> list[tuple[float, ...]]:
        long = 3.0 * self._longest
        return [(0.01, max(f * self._longest, 10 * data.period), long) for f in (0.003, 0.02, 0.08)]

    def output(self, data: Data, x: Floats, theta: Sequence[float]) -> Floats:
        gain, tau_min, tau_max = theta
        third, mean, taus = _relaxations_of(gain, tau_min, tau_max, self.reference_s)
        return add_relaxation(x, taus, data.dt, data.starts, third, mean)

    def find_sighting(self, data: Data, sigma: float) -> Sighting | None:
        held = longest_hold(data, sigma)
        if held is None:
            return None
        theta = (held.gain, HELD_SHORTEST_S, HELD_TIMES_LONGER * held.seconds)
        bounds = zip(theta, self.parameters, strict=True)
        return Sighting(
            theta=tuple(min(max(v, p.low), p.high) for v, p in bounds),
            intervals={"gain_per_decade": (held.gain, held.low, held.high, "1/decade")},
            says=f"The recording was made under feedback: from {held.start_s:.3g} to "
            f"{held.end_s:.3g} s the reading is constant, and the drive drifts opposite to the "
            f"last move by {100 * held.gain:.2g} % of it per decade of time. The controller "
            "compensates the stage's creep; a recording without feedback measures it better.",
        )

    def probes(self, data: Data) -> list[Probe]:
        taus = (0.02 * self._longest, 3.0 * self._longest)
        return [Probe(float(g), (float(g), *taus)) for g in np.geomspace(1e-4, 0.1, 10)]

    def blocks(self, theta: Sequence[float], amplitudes: Floats, data: Data) -> tuple[Block, ...]:
        keys = ("gain_per_decade", "tau_min_s", "tau_max_s")
        params: dict[str, float | tuple[float, ...]] = {
            k: float(v) for k, v in zip(keys, theta, strict=True)
        }
        if self.reference_s != REFERENCE_S:
            params["reference_s"] = self.reference_s
        return (Block("creep", "stage", params),)

    def describe(self, values: Mapping[str, tuple[float, str]]) -> str:
        g = values["gain_per_decade"][0]
        return (
            f"After every move the stage creeps in the same direction by {100 * g:.2g} % of "
            "the move per decade of time; wait, or let the controller compensate it."
        )


class CreepFromStart(Creep):
    """Creep that adds to a model that was identified without any: all of it counts, not only what
    follows after 0.1 s."""

    key = "creep-from-start"
    refines = ("creep",)
    beside_model = True
    reference_s = 0.0

    def probes(self, data: Data) -> list[Probe]:
        return []

    def find_sighting(self, data: Data, sigma: float) -> Sighting | None:
        return None


def _variants(s: Scales) -> list[Block]:
    long = 3 * s.seconds
    return [
        Block("creep", "stage", {"gain_per_decade": 0.015, "tau_min_s": a, "tau_max_s": long})
        for a in (0.1, 20 * s.period_s, 0.5)
    ] + [
        Block(
            "creep",
            "stage",
            {"gain_per_decade": 0.015, "tau_min_s": 0.1, "tau_max_s": long, "reference_s": 0.0},
        )
    ]


PHYSICS = Physics(
    name="creep",
    kinds=(KIND,),
    candidates=lambda data: [Creep(data), CreepFromStart(data)],
    specimens={"creep": Specimen(_variants)},
    distinguished_by={"drift": "holds of ten seconds, approached from above and from below"},
)
