"""A window of future drive values, improved by Gauss-Newton sweeps.

The unknowns are drive values x_1 ... x_P at nodes spaced Tp; x_0 and x_-1 have been applied. At
each node the model gives y_j = S(sum_i (b_i + k_i rate_j) H_i(x_j)), and a sweep lowers

    sum_j w_j (y_j - target_j)^2 + sum_j s_j (x_j - 2 x_{j-1} + x_{j-2})^2.

The model's rate term makes the map from drive to displacement non-minimum-phase: solved forward
in time it explodes. Solved as one least-squares problem over the window, the unstable part is
integrated backward from the window's end, where the smoothness s_j is made stiff to replace the
unknown future. The Jacobian takes all operators as moving: dy_j = S' (W_j dx_j + K_j drate_j) with
W = sum (b + k rate), K = sum k H. This is the slope over a full stroke; it is blind to the small
operators that make the weights non-monotone after each reversal, and so does not lose its way in
them. The drive range and the largest rate are part of the sum, as stiff springs beyond them. Three
unknowns a row: the normal equations are pentadiagonal, and a sweep is O(P n).

The rate at a node is the model's backward difference over the sampling period T = Tp / M, taken
from the parabola through three nodes; for M = 1 it is (x_j - x_{j-1}) / T exactly.
"""

import math

from numba import njit

from dehyst.models.model import Floats

SPRING = 300.0  # stiffness beyond drive range and rate, times the squared slope dy/du

FAST = {"reassoc", "contract", "nsz", "arcp"}  # sums over operators may be reordered

R, B, K, B_STATIC = range(4)  # rows of `weights` (4, n)


@njit(cache=True, nogil=True, fastmath=FAST)
def move(weights: Floats, h: Floats, v: float) -> tuple[float, float]:
    """Advance the plays h (n,) to the input v. Returns sum b H and sum k H."""
    z = 0.0
    kh = 0.0
    for i in range(h.size):
        x = max(v - weights[0, i], min(v + weights[0, i], h[i]))
        h[i] = x
        z += weights[1, i] * x
        kh += weights[2, i] * x
    return z, kh


@njit(cache=True, nogil=True)
def evaluate(
    weights: Floats,
    c: Floats,
    u_offset: float,
    x: Floats,
    x_0: float,
    x_before: float,
    h_0: Floats,
    h: Floats,
    period: float,
    half: float,
    target: Floats,
    trust: Floats,
    smooth: Floats,
    bounds: Floats,
    rows: Floats,
) -> tuple[float, float]:
    """Cost of a plan: weighted squared error, and roughness with what the springs take.

    x, target, trust, smooth: (P,); h_0: (n,) plays at x_0, left as they are; h: (n,) scratch;
    period: Tp; half: T / (2 Tp); bounds (4,): lowest and highest drive, largest travel
    from node to node, stiffness of the springs. rows (4, P) is overwritten with the error and with
    dy_j / d(x_{j-1}, x_j, x_{j+1}).
    """
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
        over = abs(after - now) - bounds[2]
        if over > 0.0:
            rough += bounds[3] * over * over
        over = max(after - bounds[1], bounds[0] - after)
        if over > 0.0:
            rough += bounds[3] * over * over
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
def sweep(
    x: Floats,
    x_0: float,
    x_before: float,
    trust: Floats,
    smooth: Floats,
    bounds: Floats,
    damping: float,
    rows: Floats,
    bands: Floats,
) -> None:
    """One damped Gauss-Newton step. rows (4, P) as `evaluate` left them; bands (4, P) scratch,
    whose row 3 holds the step on return: the new plan is x - bands[3]."""
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
        stiff = bounds[3] if abs(x[j] - now) > bounds[2] else 0.0
        if stiff > 0.0:
            pull = stiff * (x[j] - now - math.copysign(bounds[2], x[j] - now))
        before, now = now, x[j]
        a0[j] += w * mid * mid + s + stiff
        g[j] += mid * e + bend + pull
        if now > bounds[1] or now < bounds[0]:
            a0[j] += bounds[3]
            g[j] += bounds[3] * (now - (bounds[1] if now > bounds[1] else bounds[0]))
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
