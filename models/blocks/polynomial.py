"""A static polynomial y = a_0 + a_1 x + a_2 x^2 + ... (nonlinear sensor, asymmetry)."""

from numba import njit

from dehyst.models.blocks.kind import Kind, Param, Values, no_state, settled_nothing
from dehyst.models.forward import polynomial
from dehyst.models.model import Floats

CODE = 11


@njit(cache=True, nogil=True)
def step(p: Floats, s: Floats, x: float, t: float, dt: float, ch: float) -> float:
    """p: ascending coefficients; no state."""
    return polynomial(p, x)


@njit(cache=True, nogil=True)
def solve(p: Floats, y: float, guess: float) -> float:
    """Input x near `guess` with polynomial(p, x) = y: Newton with halved steps where the error
    grows; ends at rounding or where the slope is lost."""
    x = guess
    error = polynomial(p, x) - y
    for _ in range(60):
        slope = 0.0
        for j in range(p.size - 1, 0, -1):
            slope = slope * x + j * p[j]
        if error == 0.0 or slope == 0.0:
            break
        move = -error / slope
        for _ in range(30):
            trial = polynomial(p, x + move) - y
            if abs(trial) < abs(error):
                break
            move *= 0.5
        if abs(trial) >= abs(error):
            break
        x += move
        error = trial
    return x


@njit(cache=True, nogil=True)
def run(p: Floats, s: Floats, x: Floats, t: Floats, ch: Floats, y: Floats) -> None:
    """The whole record: y (N,) for x (N,) at times t (N,)."""
    for i in range(x.size):
        dt = t[i] - t[i - 1] if i > 0 else 0.0
        y[i] = step(p, s, x[i], t[i], dt, ch[i] if ch.size > 0 else 0.0)


def _pack(values: Values, dt: float) -> Floats:
    return values["coefficients"]


def _check(values: Values) -> str:
    return "" if values["coefficients"].size >= 2 else "coefficients: two or more are needed"


KIND = Kind(
    name="polynomial",
    says="a static nonlinearity",
    places=("stage", "sensor"),
    params=(Param("coefficients", "coefficients", "", -1e12, 1e12, "ascending", many=True),),
    code=CODE,
    step=step,
    run=run,
    pack=_pack,
    size=no_state,
    start=settled_nothing,
    causal=True,
    check=_check,
)
