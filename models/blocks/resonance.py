"""One mechanical mode: y = (1 - share) x + share q,  q'' + 2 z w q' + w^2 q = w^2 x.

Exact for an input that runs in straight lines between the samples, for any damping z.
"""

import math

from numba import njit

from dehyst.models.blocks.kind import SAME, Kind, Param, pack_in_order
from dehyst.models.model import Floats

CODE = 2


@njit(cache=True, nogil=True)
def _decay(s: Floats, w: float, z: float, dt: float) -> None:
    """Free decay over dt as a 2 x 2 matrix in s[4:8]: (e, e') after = M (e, e') before."""
    if abs(z - 1.0) < 1e-7:
        fall = math.exp(-w * dt)
        cosine, sine = fall, fall * dt
    elif z < 1.0:
        damped = w * math.sqrt(1.0 - z * z)
        fall = math.exp(-z * w * dt)
        cosine, sine = fall * math.cos(damped * dt), fall * math.sin(damped * dt) / damped
    else:
        damped = w * math.sqrt(z * z - 1.0)
        slow, fast = math.exp((damped - z * w) * dt), math.exp((-damped - z * w) * dt)
        cosine, sine = 0.5 * (slow + fast), 0.5 * (slow - fast) / damped
    s[3] = dt
    s[4], s[5] = cosine + z * w * sine, sine
    s[6], s[7] = -w * w * sine, cosine - z * w * sine


@njit(cache=True, nogil=True)
def step(p: Floats, s: Floats, x: float, t: float, dt: float, ch: float) -> float:
    """p: [frequency, damping, share]; s: [q, q', x before, dt of the matrix, matrix (4)]."""
    if dt > 0.0:
        w, z = 2.0 * math.pi * p[0], p[1]
        if abs(dt - s[3]) > SAME * dt:
            _decay(s, w, z, dt)
        ramp = (x - s[2]) / dt
        shift = 2.0 * z / w * ramp  # how far the mode trails a ramp
        e, de = s[0] - s[2] + shift, s[1] - ramp
        s[0] = x - shift + s[4] * e + s[5] * de
        s[1] = ramp + s[6] * e + s[7] * de
    s[2] = x
    return (1.0 - p[2]) * x + p[2] * s[0]


@njit(cache=True, nogil=True)
def run(p: Floats, s: Floats, x: Floats, t: Floats, ch: Floats, y: Floats) -> None:
    """The whole record: y (N,) for x (N,) at times t (N,)."""
    for i in range(x.size):
        dt = t[i] - t[i - 1] if i > 0 else 0.0
        y[i] = step(p, s, x[i], t[i], dt, ch[i] if ch.size > 0 else 0.0)


def _start(p: Floats, s: Floats, x: float) -> None:
    s[0] = s[2] = x


KIND = Kind(
    name="resonance",
    says="a mechanical resonance",
    places=("stage", "sensor"),
    params=(
        Param("frequency_hz", "frequency", "Hz", 1e-3, 1e6, "natural frequency"),
        Param("damping", "damping", "", 1e-6, 10.0, "damping ratio"),
        Param("share", "share", "", 0.0, 1.0, "part of the stroke that the mode carries"),
    ),
    code=CODE,
    step=step,
    run=run,
    pack=pack_in_order("frequency", "damping", "share"),
    size=lambda p, dt: 8,
    start=_start,
    causal=False,
)
