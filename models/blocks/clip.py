"""The drive is limited to a range: y = min(max(x, low), high)."""

from numba import njit

from dehyst.models.blocks.kind import Kind, Param, Values, no_state, pack_in_order, settled_nothing
from dehyst.models.model import Floats

CODE = 5


@njit(cache=True, nogil=True)
def step(p: Floats, s: Floats, x: float, t: float, dt: float, ch: float) -> float:
    """p: [low, high]; no state."""
    return min(max(x, p[0]), p[1])


@njit(cache=True, nogil=True)
def run(p: Floats, s: Floats, x: Floats, t: Floats, ch: Floats, y: Floats) -> None:
    """The whole record: y (N,) for x (N,) at times t (N,)."""
    for i in range(x.size):
        dt = t[i] - t[i - 1] if i > 0 else 0.0
        y[i] = step(p, s, x[i], t[i], dt, ch[i] if ch.size > 0 else 0.0)


def _check(values: Values) -> str:
    return "" if values["min"][0] < values["max"][0] else "min must be below max"


KIND = Kind(
    name="clip",
    says="the drive is clipped",
    places=("drive",),
    params=(
        Param("min_{u}", "min", "", -1e9, 1e9, "lower end"),
        Param("max_{u}", "max", "", -1e9, 1e9, "upper end"),
    ),
    code=CODE,
    step=step,
    run=run,
    pack=pack_in_order("min", "max"),
    size=no_state,
    start=settled_nothing,
    causal=True,
    check=_check,
)
