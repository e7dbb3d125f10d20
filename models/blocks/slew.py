"""Slew limit: y follows x, at most `rate` drive units a second (the amplifier's current limit)."""

from numba import njit

from dehyst.models.blocks.kind import Kind, Param, pack_in_order
from dehyst.models.model import Floats

CODE = 4


@njit(cache=True, nogil=True)
def step(p: Floats, s: Floats, x: float, t: float, dt: float, ch: float) -> float:
    """p: [rate]; s: [y]."""
    most = p[0] * dt
    s[0] += min(max(x - s[0], -most), most)
    return s[0]


@njit(cache=True, nogil=True)
def run(p: Floats, s: Floats, x: Floats, t: Floats, ch: Floats, y: Floats) -> None:
    """The whole record: y (N,) for x (N,) at times t (N,)."""
    for i in range(x.size):
        dt = t[i] - t[i - 1] if i > 0 else 0.0
        y[i] = step(p, s, x[i], t[i], dt, ch[i] if ch.size > 0 else 0.0)


def _start(p: Floats, s: Floats, x: float) -> None:
    s[0] = x


KIND = Kind(
    name="slew",
    says="a slew limit of the drive",
    places=("drive",),
    params=(Param("rate_{u}_per_s", "rate", "/s", 1e-9, 1e12, "largest rate"),),
    code=CODE,
    step=step,
    run=run,
    pack=pack_in_order("rate"),
    size=lambda p, dt: 1,
    start=_start,
    causal=True,
)
