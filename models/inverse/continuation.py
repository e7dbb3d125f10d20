"""Extrapolate targets beyond the known ones, and weight them by how far they can be trusted.

The exact causal inverse of the rate-dependent model is unstable (it would have to be
1 / (1 - tau s)). The stable approximation here solves the same window as with preview, on targets
that are continued from the past: the plan then contains y + tau y' + tau^2 y'' + ..., as far as the
continuation is right. Slope and curvature of the continuation are the smaller of two neighbouring
estimates (minmod), so that a step or a corner is not taken for a speed; both fade out with
distance, and so does the trust in the continued targets.
"""

import math

from numba import njit

from dehyst.models.inverse.tuning import TUNING
from dehyst.models.model import Floats


@njit(cache=True, nogil=True)
def _smaller(a: float, b: float) -> float:
    if a * b <= 0.0:
        return 0.0
    return a if abs(a) <= abs(b) else b


@njit(cache=True, nogil=True)
def extend(
    seq: Floats,
    trust: Floats,
    known: int,
    ahead: float,
    y: Floats,
    spacing_s: float,
    low: float,
    high: float,
) -> None:
    """Continue seq[:known] into seq[known:], in place; set trust (same length).

    y: (4,) the newest target and those one, two and three spacings before it; seq[known] is
    `ahead` spacings (0 < ahead <= 1) after the newest; low, high: limits of the continuation.
    """
    d1, d2, d3 = y[0] - y[1], y[1] - y[2], y[2] - y[3]
    bend = _smaller(d1 - d2, d2 - d3)
    speed = _smaller(d1, 2.0 * d2)
    keep = math.exp(-spacing_s / TUNING.slope_fades_s)
    fade = math.exp(-spacing_s / TUNING.bend_fades_s)
    for j in range(known):
        trust[j] = 1.0
    at = y[0]
    for j in range(known, seq.size):
        speed = keep * (speed + bend)
        bend *= fade
        seq[j] = min(max(at + ahead * speed, low), high)
        at += speed
        if at < low or at > high:
            at = min(max(at, low), high)
            speed = bend = 0.0
        t = (j - known + ahead) * spacing_s / TUNING.trust_fades_s
        trust[j] = 1.0 / (1.0 + t * t)
