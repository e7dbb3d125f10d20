"""Compiled operators and filters over joined recordings, and one-sample updates of linear elements,
which the blocks of models.physics use as well.

Arrays of length N are joined recordings; `starts` (N,) marks the first sample of each recording,
where every state restarts. Filters act on each column of x (N, k) separately.
"""

import math

import numpy as np
from numba import njit

from dehyst.models.signals.joined import Bools, Floats, Ints
from dehyst.models.signals.pasts import begin_dahl, begin_plays

Decay = tuple[float, float, float, float]


@njit(cache=True, nogil=True)
def lag_step(y: float, before: float, x: float, trail: float, decay: float) -> float:
    """Return the next output of tau dy/dt + y = x for an input that is linear from `before` to x;
    y: the present output; trail: tau times the input's slope; decay: exp(-dt / tau)."""
    return x - trail + decay * (y - before + trail)


@njit(cache=True, nogil=True)
def free_decay(w: float, z: float, dt: float) -> Decay:
    """Return the transition matrix, row by row, of displacement and speed of a free mode or
    second-order lag over dt (w: undamped frequency [rad/s], z: damping)."""
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
    return cosine + z * w * sine, sine, -w * w * sine, cosine - z * w * sine


@njit(cache=True, nogil=True)
def second_order_step(
    q: float, speed: float, before: float, x: float, ramp: float, shift: float, decay: Decay
) -> tuple[float, float]:
    """Return the next displacement and speed of q'' + 2 z w q' + w^2 q = w^2 x for an input that is
    linear from `before` to x. ramp: the input's slope; shift: 2 z / w times ramp, the lag of q;
    decay: see `free_decay`."""
    m11, m12, m21, m22 = decay
    e, de = q - before + shift, speed - ramp
    return x - shift + m11 * e + m12 * de, ramp + m21 * e + m22 * de


@njit(cache=True, nogil=True)
def plays(r: Floats, u: Floats, starts: Bools | Ints) -> Floats:
    """Return play operators (N, n), see models.hysteresis.play. starts: where they restart,
    de-energised, or with the past that the mark selects (`signals.pasts`)."""
    out = np.empty((u.size, r.size))
    h = np.zeros(r.size)
    low, high = u.min(), u.max()
    for t in range(u.size):
        if starts[t]:
            begin_plays(h, r, int(starts[t]), low, high)
        for i in range(r.size):
            h[i] = max(u[t] - r[i], min(u[t] + r[i], h[i]))
            out[t, i] = h[i]
    return out


@njit(cache=True, nogil=True)
def dahl(length: Floats, u: Floats, starts: Bools | Ints) -> Floats:
    """Return Dahl operators (N, n): dz/du = (sign(du) - z) / length, exact over one sample.

    P. Dahl, "Solid friction damping of mechanical vibrations", 1976, exponent 1. They are a
    rate-independent memory that plays cannot represent (loops of the Duhem and Bouc-Wen type).
    """
    out = np.empty((u.size, length.size))
    z = np.zeros(length.size)
    low, high = u.min(), u.max()
    for t in range(u.size):
        du = 0.0
        if starts[t]:
            begin_dahl(z, length, int(starts[t]), low, high, u[t])
        else:
            du = u[t] - u[t - 1]
        if du != 0.0:
            s = 1.0 if du > 0 else -1.0
            for i in range(length.size):
                z[i] = s + (z[i] - s) * np.exp(-abs(du) / length[i])
        out[t] = z
    return out


@njit(cache=True, nogil=True)
def lowpass(x: Floats, ratio: Floats, starts: Bools, stepped: bool = False) -> Floats:
    """Return the first-order low-pass of each column, exact for an input that is linear over each
    step, or (stepped) that has had its present value since the previous sample.

    ratio: (N,) dt / tau for each sample. Starts settled at the first sample.
    """
    out = np.empty_like(x)
    last, decay = -1.0, 0.0
    for t in range(x.shape[0]):
        if starts[t]:
            out[t] = x[t]
            continue
        if ratio[t] != last:
            last = ratio[t]
            decay = np.exp(-last)
        for j in range(x.shape[1]):
            before = x[t, j] if stepped else x[t - 1, j]
            trail = (x[t, j] - before) / last
            out[t, j] = lag_step(out[t - 1, j], before, x[t, j], trail, decay)
    return out


@njit(cache=True, nogil=True, fastmath={"reassoc", "contract"})
def add_relaxation(
    x: Floats, taus: Floats, dt: Floats, starts: Bools, gain: float, mean: float
) -> Floats:
    """Return x + gain (sum of low-passes of x, time constants taus (K,) [s], - mean x), per column.

    Exact for an input that is linear over each step. dt: (N,) sampling period of each sample [s].
    Starts settled at the first sample: the stage is assumed to have been at rest before. The state
    is the lag of each low-pass, so that a sample costs few operations per time constant.
    """
    out = np.empty_like(x)
    n, m = taus.size, x.shape[1]
    behind, total, step = np.zeros((n, m)), np.empty(m), np.empty(m)
    single, decay, share = np.zeros(n), np.empty(n), np.empty(n)
    last, own = -1.0, 1.0 + gain * (n - mean)
    for t in range(x.shape[0]):
        if starts[t]:
            behind[:], single[:] = 0.0, 0.0
            out[t] = own * x[t]
            continue
        if dt[t] != last:
            last = dt[t]
            decay[:] = np.exp(-last / taus)
            share[:] = -np.expm1(-last / taus) * taus / last
        if m == 1:
            moved, late = x[t, 0] - x[t - 1, 0], 0.0
            for k in range(n):
                single[k] = decay[k] * single[k] - share[k] * moved
                late += single[k]
            out[t, 0] = own * x[t, 0] + gain * late
            continue
        for j in range(m):
            step[j] = x[t, j] - x[t - 1, j]
            total[j] = 0.0
        for k in range(n):
            row, fall, weight = behind[k], decay[k], share[k]
            for j in range(m):
                row[j] = fall * row[j] - weight * step[j]
                total[j] += row[j]
        for j in range(m):
            out[t, j] = own * x[t, j] + gain * total[j]
    return out


@njit(cache=True, nogil=True)
def second_order(
    x: Floats, omega: Floats, damping: float, starts: Bools, stepped: bool = False
) -> Floats:
    """Return w^2 / (s^2 + 2 z w s + w^2) of each column, exact for an input that is linear over
    each step, or (stepped) that has had its present value since the previous sample.

    omega: (N,) w * dt for each sample (constant within a recording). Starts settled.
    """
    out = np.empty_like(x)
    _second_order(x, omega, damping, starts, stepped, out, np.empty((0, 0)))
    return out


@njit(cache=True, nogil=True)
def mode(x: Floats, omega: Floats, damping: float, starts: Bools) -> Floats:
    """Return (N, 2): `second_order` of one input x (N,), and its rate divided by w."""
    out, rate = np.empty((x.size, 1)), np.empty((x.size, 1))
    _second_order(x.reshape(-1, 1), omega, damping, starts, False, out, rate)
    return np.concatenate((out, rate), axis=1)


@njit(cache=True, nogil=True)
def _second_order(
    x: Floats,
    omega: Floats,
    damping: float,
    starts: Bools,
    stepped: bool,
    out: Floats,
    rates: Floats,
) -> None:
    m = x.shape[1]
    q, speed = np.empty(m), np.empty(m)  # displacement, and its change per sample
    decay, last = (1.0, 0.0, 0.0, 1.0), -1.0
    for t in range(x.shape[0]):
        w = omega[t]
        if not starts[t] and w != last:
            decay, last = free_decay(w, damping, 1.0), w
        for j in range(m):
            if starts[t]:
                q[j], speed[j] = x[t, j], 0.0
            else:
                before = x[t, j] if stepped else x[t - 1, j]
                ramp = x[t, j] - before
                shift = 2.0 * damping / w * ramp
                q[j], speed[j] = second_order_step(
                    q[j], speed[j], before, x[t, j], ramp, shift, decay
                )
            out[t, j] = q[j]
            if rates.size > 0:
                rates[t, j] = speed[j] / w


@njit(cache=True, nogil=True)
def slew(u: Floats, step: Floats, starts: Bools) -> Floats:
    """Return u (N,) followed with changes of at most step[t] per sample."""
    out = np.empty_like(u)
    for t in range(u.size):
        if starts[t]:
            out[t] = u[t]
        else:
            out[t] = out[t - 1] + max(-step[t], min(step[t], u[t] - out[t - 1]))
    return out


@njit(cache=True, nogil=True)
def delayed(x: Floats, shift: Floats, starts: Bools) -> Floats:
    """Return x (N,) delayed by shift[t] >= 0 samples; before a recording's start, its first value.

    Between samples it is interpolated by the cubic through the four nearest, at the newest end by
    the parabola through the last three, like the block of a delay in real time.
    """
    out = np.empty_like(x)
    first = 0
    for t in range(x.size):
        if starts[t]:
            first = t
        at = t - shift[t]
        if at <= first:
            out[t] = x[first]
            continue
        i = int(np.floor(at))
        low = max(i - 1, first)
        high = min(i + 2, t)
        if high == t and shift[t] < 1.0:
            low = max(t - 2, first)
        total = 0.0
        for a in range(low, high + 1):
            part = x[a]
            for b in range(low, high + 1):
                if b != a:
                    part *= (at - b) / (a - b)
            total += part
        out[t] = total
    return out
