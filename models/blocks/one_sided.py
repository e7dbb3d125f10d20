"""Hysteresis that differs between rising and falling: y = a max(u - H, 0)^2 + b max(H - u, 0)^2,

H the play of width r on the drive. It reads the drive as it reaches the hysteresis, and adds to
the hysteresis' displacement. The play starts de-energised, from 0 at `center`.
"""

from numba import njit

from dehyst.models.blocks.kind import Kind, Param, pack_in_order
from dehyst.models.model import Floats

CODE = 19


@njit(cache=True, nogil=True)
def step(p: Floats, s: Floats, x: float, t: float, dt: float, ch: float) -> float:
    """p: [threshold, rising, falling, center]; s: [play]; x: drive."""
    v = x - p[3]
    s[0] = max(v - p[0], min(v + p[0], s[0]))
    ahead = v - s[0]
    return (p[1] if ahead > 0.0 else p[2]) * ahead * ahead


@njit(cache=True, nogil=True)
def run(p: Floats, s: Floats, x: Floats, t: Floats, ch: Floats, y: Floats) -> None:
    """The whole record: y (N,) for x (N,) at times t (N,)."""
    for i in range(x.size):
        dt = t[i] - t[i - 1] if i > 0 else 0.0
        y[i] = step(p, s, x[i], t[i], dt, ch[i] if ch.size > 0 else 0.0)


def _start(p: Floats, s: Floats, x: float) -> None:
    s[0] = 0.0


KIND = Kind(
    name="one_sided",
    says="hysteresis that differs between rising and falling",
    places=("stage",),
    params=(
        Param("threshold_{u}", "threshold", "", 0.0, 1e9, "width of the play"),
        Param("rising_{y}_per_{u}2", "rising", "", -1e9, 1e9, "of the square while rising"),
        Param("falling_{y}_per_{u}2", "falling", "", -1e9, 1e9, "of the square while falling"),
        Param("center_{u}", "center", "", -1e9, 1e9, "drive that counts as 0", default=(0.0,)),
    ),
    code=CODE,
    step=step,
    run=run,
    pack=pack_in_order("threshold", "rising", "falling", "center"),
    size=lambda p, dt: 1,
    start=_start,
    causal=True,
    invertible=False,
)
