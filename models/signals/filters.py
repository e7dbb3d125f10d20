"""Operators and filters over joined recordings, compiled.

All arrays are joined recordings; `starts` (N,) bool marks the first sample of each recording,
where every state begins anew. Filters act on columns: x (N, k), each column for itself.
"""

import math

import numpy as np
from numba import njit

from dehyst.models.signals.joined import Bools, Floats


@njit(cache=True, nogil=True)
def plays(r: Floats, u: Floats, starts: Bools) -> Floats:
    """Play operators (N, n), de-energised (0) before each recording. See models.hysteresis.play."""
    out = np.empty((u.size, r.size))
    h = np.zeros(r.size)
    for t in range(u.size):
        if starts[t]:
            h[:] = 0.0
        for i in range(r.size):
            h[i] = max(u[t] - r[i], min(u[t] + r[i], h[i]))
            out[t, i] = h[i]
    return out


@njit(cache=True, nogil=True)
def dahl(length: Floats, u: Floats, starts: Bools) -> Floats:
    """Dahl operators (N, n): dz/du = (sign(du) - z) / length, exact over one sample.

    P. Dahl, "Solid friction damping of mechanical vibrations", 1976, exponent 1. A
    rate-independent memory that plays do not span (loops of Duhem and Bouc-Wen kind).
    """
    out = np.empty((u.size, length.size))
    z = np.zeros(length.size)
    for t in range(u.size):
        du = 0.0
        if starts[t]:
            z[:] = 0.0
        else:
            du = u[t] - u[t - 1]
        if du != 0.0:
            s = 1.0 if du > 0 else -1.0
            for i in range(length.size):
                z[i] = s + (z[i] - s) * np.exp(-abs(du) / length[i])
        out[t] = z
    return out


@njit(cache=True, nogil=True)
def lowpass(x: Floats, ratio: Floats, starts: Bools) -> Floats:
    """First-order low-pass of each column, exact for an input linear over each step.

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
            trail = (x[t, j] - x[t - 1, j]) / last
            out[t, j] = x[t, j] - trail + decay * (out[t - 1, j] - x[t - 1, j] + trail)
    return out


@njit(cache=True, nogil=True)
def relaxations(x: Floats, taus: Floats, dt: Floats, starts: Bools) -> Floats:
    """Sum of the low-passes of each column with all time constants taus (K,) [s].

    dt: (N,) sampling period of each sample [s]. Settled at the first sample: the stage is taken
    to have rested before.
    """
    out = np.empty_like(x)
    n, m = taus.size, x.shape[1]
    state = np.zeros((n, m))
    decay = np.empty(n)
    share = np.empty(n)
    last = -1.0
    for t in range(x.shape[0]):
        if starts[t]:
            for k in range(n):
                state[k] = x[t]
            out[t] = n * x[t]
            continue
        if dt[t] != last:
            last = dt[t]
            for k in range(n):
                decay[k] = np.exp(-last / taus[k])
                share[k] = taus[k] / last * (1.0 - decay[k])
        for j in range(m):
            out[t, j] = 0.0
        for k in range(n):
            d, a = decay[k], share[k]
            for j in range(m):
                # exact for an input that runs straight over the step
                state[k, j] = d * state[k, j] + (1.0 - a) * x[t, j] + (a - d) * x[t - 1, j]
                out[t, j] += state[k, j]
    return out


@njit(cache=True, nogil=True)
def second_order(x: Floats, omega: Floats, damping: float, starts: Bools) -> Floats:
    """w^2 / (s^2 + 2 z w s + w^2) of each column, exact for an input linear over each step.

    omega: (N,) w * dt for each sample (constant inside a recording). Starts settled.
    """
    out = np.empty_like(x)
    _second_order(x, omega, damping, starts, out, np.empty((0, 0)))
    return out


@njit(cache=True, nogil=True)
def mode(x: Floats, omega: Floats, damping: float, starts: Bools) -> Floats:
    """(N, 2): the same of one input x (N,), and its rate over w."""
    out, rate = np.empty((x.size, 1)), np.empty((x.size, 1))
    _second_order(x.reshape(-1, 1), omega, damping, starts, out, rate)
    return np.concatenate((out, rate), axis=1)


@njit(cache=True, nogil=True)
def _second_order(
    x: Floats, omega: Floats, damping: float, starts: Bools, out: Floats, rates: Floats
) -> None:
    m = x.shape[1]
    p = np.zeros(m)  # deviation of the mass from the input, d = y - x
    v = np.zeros(m)  # velocity of the mass times dt
    a11 = a12 = a21 = a22 = behind = 0.0
    last = -1.0
    for t in range(x.shape[0]):
        if starts[t]:
            p[:] = 0.0
            v[:] = 0.0
            out[t] = x[t]
            if rates.size > 0:
                rates[t] = 0.0
            continue
        w = omega[t]
        if w != last:
            # d'' + 2 z w d' + w^2 d = -x'' - 2 z w x'; time in samples
            e = np.exp(-damping * w)
            wd2 = w * w * (1.0 - damping * damping)
            if wd2 > 1e-12:
                wd = np.sqrt(wd2)
                c, s = np.cos(wd), np.sin(wd) / wd
            elif wd2 < -1e-12:
                wd = np.sqrt(-wd2)
                c, s = np.cosh(wd), np.sinh(wd) / wd
            else:
                c, s = 1.0, 1.0
            a11 = e * (c + damping * w * s)
            a12 = e * s
            a21 = -e * w * w * s
            a22 = e * (c - damping * w * s)
            behind = 2.0 * damping / w
            last = w
        for j in range(m):
            # the input's slope over this step: y relative to the ramp x[t-1] + slope * time
            slope = x[t, j] - x[t - 1, j]
            lag = behind * slope  # steady deviation behind a ramp is -lag
            q = p[j] + lag
            rate = v[j] - slope
            p[j] = a11 * q + a12 * rate - lag
            v[j] = a21 * q + a22 * rate + slope
            out[t, j] = x[t, j] + p[j]
            if rates.size > 0:
                rates[t, j] = v[j] / w


@njit(cache=True, nogil=True)
def slew(u: Floats, step: Floats, starts: Bools) -> Floats:
    """u followed with at most step[t] per sample."""
    out = np.empty_like(u)
    for t in range(u.size):
        if starts[t]:
            out[t] = u[t]
        else:
            out[t] = out[t - 1] + max(-step[t], min(step[t], u[t] - out[t - 1]))
    return out


@njit(cache=True, nogil=True)
def delayed(x: Floats, shift: Floats, starts: Bools) -> Floats:
    """x (N,) later by shift[t] >= 0 samples; before a recording's start its first value stands.

    Between samples the cubic through the four nearest, at the newest end the parabola through
    the last three, as the delay's block does in real time.
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


@njit(cache=True, nogil=True)
def free_decay(w: float, z: float, dt: float) -> tuple[float, float, float, float]:
    """The free motion of a mode or second-order lag (w: its undamped frequency [rad/s], z: damping)
    over dt, as a matrix of displacement and speed, row by row."""
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
