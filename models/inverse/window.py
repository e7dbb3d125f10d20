"""Improve a window of future drive values by Gauss-Newton sweeps.

The unknowns are drive values x_1 ... x_P at nodes spaced Tp; x_0 and x_-1 have been applied. At
each node the model gives y_j = S(sum_i (b_i + k_i rate_j) H_i(x_j)), and a sweep lowers

    sum_j w_j (y_j - target_j)^2 + sum_j s_j (x_j - 2 x_{j-1} + x_{j-2})^2.

The model's rate term makes the map from drive to displacement non-minimum-phase: solved forward
in time it explodes. Solved as one least-squares problem over the window, the unstable part is
integrated backward from the window's end, where the smoothness s_j is made stiff to replace the
unknown future. The Jacobian takes all operators as moving: dy_j = S' (W_j dx_j + K_j drate_j) with
W = sum (b + k rate), K = sum k H. This is the slope over a full stroke; it ignores the small
operators that make the weights non-monotone after each reversal, so they do not mislead the
sweeps. The sum includes the drive range and the largest rate, as stiff springs beyond them. Each
row has three unknowns: the normal equations are pentadiagonal, and a sweep is O(P n).

The rate at a node is the model's backward difference over the sampling period T = Tp / M, taken
from the parabola through three nodes; for M = 1 it is (x_j - x_{j-1}) / T exactly.
"""

import math

from numba import njit

from dehyst.models.hysteresis.operators import Operators, move
from dehyst.models.inverse.state import Nodes
from dehyst.models.model import Floats


@njit(cache=True, nogil=True)
def between(a: float, b: float, slope_a: float, slope_b: float, q: float) -> float:
    """Return the cubic from a to b with the slopes slope_a, slope_b at 0 < q <= 1."""
    p = 1.0 - q
    return (
        b * q * q * (3.0 - 2.0 * q)
        + a * (1.0 + 2.0 * q) * p * p
        + (slope_a * p - slope_b * q) * q * p
    )


@njit(cache=True, nogil=True)
def evaluate(
    hysteresis: Operators, nodes: Nodes, x: Floats, h_0: Floats, h: Floats
) -> tuple[float, float]:
    """Return the cost of a plan x (P,): weighted squared error, and roughness plus spring energy.

    h_0: (n,) plays at x_0, not changed; h: (n,) scratch. `nodes.rows` is overwritten with the
    error and with dy_j / d(x_{j-1}, x_j, x_{j+1}).
    """
    weights, c, u_offset = hysteresis.weights, hysteresis.c, hysteresis.u_offset[0]
    target, trust, smooth, rows = nodes.target, nodes.trust, nodes.smooth, nodes.rows
    frame = nodes.frame[0]
    x_0, x_before, period, half = frame.x_0, frame.x_before, frame.period, frame.half
    low, high, travel, spring = frame.low, frame.high, frame.travel, frame.spring
    last = x.size - 1
    w_b, w_k = 0.0, 0.0
    for i in range(h.size):
        h[i] = h_0[i]
        w_b += weights[1, i]
        w_k += weights[2, i]
    error, rough = 0.0, 0.0
    before, now = x_before, x_0
    for j in range(x.size):
        after = x[j]
        bend = after - 2.0 * now + before
        rough += smooth[j] * bend * bend
        over = abs(after - now) - travel
        if over > 0.0:
            rough += spring * over * over
        over = max(after - high, low - after)
        if over > 0.0:
            rough += spring * over * over
        before, now = now, after
        if j < last:
            rate = ((0.5 - half) * x[j + 1] + 2.0 * half * now - (0.5 + half) * before) / period
        else:
            rate = (now - before) / period
        z, kh = move(weights, h, now - u_offset)
        z += rate * kh
        y, slope = 0.0, 0.0
        for m in range(c.size - 1, -1, -1):
            slope = slope * z + y
            y = y * z + c[m]
        e = y - target[j]
        error += trust[j] * e * e
        q = slope * kh / period
        rows[0, j] = e
        if j < last:
            rows[1, j] = -q * (0.5 + half)
            rows[2, j] = slope * (w_b + w_k * rate) + q * 2.0 * half
            rows[3, j] = q * (0.5 - half)
        else:
            rows[1, j] = -q
            rows[2, j] = slope * (w_b + w_k * rate) + q
            rows[3, j] = 0.0
    return error, rough


@njit(cache=True, nogil=True)
def gauss_newton_step(nodes: Nodes, x: Floats, damping: float) -> None:
    """Make one damped Gauss-Newton step from the plan x (P,), with `nodes.rows` as `evaluate` left
    them; on return the new plan is x - nodes.bands[3]."""
    trust, smooth, rows, bands = nodes.trust, nodes.smooth, nodes.rows, nodes.bands
    frame = nodes.frame[0]
    x_0, x_before = frame.x_0, frame.x_before
    low, high, travel, spring = frame.low, frame.high, frame.travel, frame.spring
    n = x.size
    a0, a1, a2, g = bands[0], bands[1], bands[2], bands[3]
    for j in range(n):
        a0[j] = damping
        a1[j] = a2[j] = g[j] = 0.0
    before, now = x_before, x_0
    for j in range(n):
        w, s = trust[j], smooth[j]
        e, left, mid, right = w * rows[0, j], rows[1, j], rows[2, j], rows[3, j]
        bend = s * (x[j] - 2.0 * now + before)
        pull = 0.0
        stiff = spring if abs(x[j] - now) > travel else 0.0
        if stiff > 0.0:
            pull = stiff * (x[j] - now - math.copysign(travel, x[j] - now))
        before, now = now, x[j]
        a0[j] += w * mid * mid + s + stiff
        g[j] += mid * e + bend + pull
        if now > high or now < low:
            a0[j] += spring
            g[j] += spring * (now - (high if now > high else low))
        if j > 0:
            a0[j - 1] += w * left * left + 4.0 * s + stiff
            a1[j - 1] += w * left * mid - 2.0 * s - stiff
            g[j - 1] += left * e - 2.0 * bend - pull
        if j > 1:
            a0[j - 2] += s
            a1[j - 2] -= 2.0 * s
            a2[j - 2] += s
            g[j - 2] += bend
        if j < n - 1:
            a0[j + 1] += w * right * right
            a1[j] += w * mid * right
            g[j + 1] += right * e
            if j > 0:
                a2[j - 1] += w * left * right
    for j in range(n):
        inverse = 1.0 / a0[j]
        l1, l2 = a1[j] * inverse, a2[j] * inverse
        if j + 1 < n:
            a0[j + 1] -= l1 * a1[j]
            a1[j + 1] -= l1 * a2[j]
            g[j + 1] -= l1 * g[j]
        if j + 2 < n:
            a0[j + 2] -= l2 * a2[j]
            g[j + 2] -= l2 * g[j]
        g[j] *= inverse
        a1[j], a2[j] = l1, l2
    for j in range(n - 1, -1, -1):
        if j + 1 < n:
            g[j] -= a1[j] * g[j + 1]
        if j + 2 < n:
            g[j] -= a2[j] * g[j + 2]
