"""The watch's arithmetic, sample by sample: baseline filter, noise floors, sums of one second.

See dehyst.models.watch for what it means. x: drive, p: predicted displacement, both as shares of
their range; e: residual in units of the model's noise.
"""

import math

import numpy as np
from numba import njit

from dehyst.models.forward import polynomial
from dehyst.models.model import Floats
from dehyst.models.play import play_step

Parts = tuple[Floats, Floats, Floats, Floats, Floats]

ZERO_S = 120.0  # how fast the baseline follows a drifting zero; the rest is averaged for ever
BEYOND = 300.0  # noises per range: where the drive has never been, the zero may shift by so much
TOGETHER_S = 0.02  # misfit hangs together in time: so long a stretch says as much as one sample
SMOOTH_S = 0.1  # slower than this is not ringing
TRUST_S = 0.3  # of a class of motion: before, the model's own figures count
FLOOR_S, FIRST_FLOOR_S = 300.0, 5.0  # memory of a class' floor; while the baseline is found
LARGEST = 25.0  # one sample counts for no more than five standard deviations
SLOW_HZ, FAST_HZ = 500.0, 2000.0  # highest rates of the filter and of the short-lag differences

PLAYS = np.array([0.005, 0.01, 0.02, 0.035, 0.055, 0.08, 0.11, 0.15, 0.2, 0.26, 0.33, 0.42])
TAUS_S = np.array([0.03, 0.1, 0.3, 1.0, 3.0, 10.0, 30.0, 100.0, 300.0, 1000.0])
SQUARE_TAUS_S = np.array([0.03, 0.3, 3.0, 30.0, 300.0])  # the same for p^2 and for the drive
N_LOW = TAUS_S.size + 2 * SQUARE_TAUS_S.size
STEPS = 4  # newest steps of the drive: what is late, and what rings
SLOPES = 2  # of them also times the position: a volt moves the stage further in the middle
N_FEATURES = 4 + STEPS + SLOPES + 2 * PLAYS.size + N_LOW

# Classes of motion: speed [ranges / s] and change of speed [ranges / s^2], each held for a moment.
SPEEDS, SPEED_HELD_S = np.array([0.003, 0.03, *np.geomspace(0.1, 12.8, 15)]), 0.1
JERKS, JERK_HELD_S = np.array([4.0, 40.0, 120.0, 400.0, 1200.0]), 0.05
N_CLASSES = (SPEEDS.size + 1) * (JERKS.size + 1)
WHOLE, RINGING, SHORT = range(3)  # rows of floors and weights

# Places in `now`.
(
    FILLED, X_BEFORE, P_BEFORE, STEP_BEFORE, SPEED, JERK, COUNT, SUM_X, SUM_P, SUM_E, KNOWN, CLASS,
    X_MEAN, E_SMOOTH, BLOCK_S, LAST_Y, STILL_S, STILL_LOW, STILL_HIGH, LEARN, SUM_RATE,
    MEMORY_S, LOWEST, HIGHEST, N_NOW,
) = range(25)  # fmt: skip
# Places in the sums of one second.
(
    B_W, B_P, B_C, B_E, B_PP, B_PC, B_CC, B_PE, B_CE, B_N, B_WHOLE, B_RINGING, B_NSHORT, B_SHORT,
    B_RAW, B_RAW2, N_BLOCK,
) = range(17)  # fmt: skip


@njit(cache=True, nogil=True)
def _floor(floors: Floats, weights: Floats, row: int, at: int, misfit2: float) -> float:
    """Expected mean square in a class of motion; until it is known, the model's own figure."""
    known = weights[row, at]
    return max((floors[row, at] * known + TRUST_S * misfit2) / (known + TRUST_S), 0.7)


@njit(cache=True, nogil=True)
def _learn(
    floors: Floats, weights: Floats, row: int, at: int, square: float, learn: float, dt: float,
    memory_s: float,
) -> None:  # fmt: skip
    """Follow the mean square of a class; lone large values count little."""
    weights[row, at] = min(weights[row, at] + learn * dt, memory_s)
    share = min(1.0, learn * dt / max(weights[row, at], dt))
    floors[row, at] += share * (min(square, 9.0 * floors[row, at]) - floors[row, at])


@njit(cache=True, nogil=True, fastmath=True)
def _along(a: Floats, b: Floats) -> float:
    """Inner product, in any order."""
    s = 0.0
    for j in range(a.size):
        s += a[j] * b[j]
    return s


@njit(cache=True, nogil=True)
def _rate_part(hysteresis: Parts, h: Floats, drive: float, rate: float) -> float:
    """How much of the model's displacement comes from its rate terms; h is advanced in place."""
    r, b, k, c, offset = hysteresis
    play_step(r, h, drive - offset[0])
    still = _along(b, h)
    return polynomial(c, still + rate * _along(k, h)) - polynomial(c, still)


@njit(cache=True, nogil=True)
def _features(
    x: float, p: float, rate: float, dt: float, z: Floats, low: Floats, steps: Floats,
    now: Floats, phi: Floats,
) -> float:  # fmt: skip
    """Fill phi; returns the creep direction."""
    phi[0], phi[1], phi[2], phi[3] = 1.0, p - 0.5, 2.0 * (p - 0.5) ** 2, rate
    for j in range(STEPS - 1, 0, -1):
        steps[j] = steps[j - 1]
    steps[0] = x - now[X_MEAN]
    now[X_MEAN] = x
    k = 4
    for j in range(STEPS):
        phi[k] = 50.0 * steps[j]
        k += 1
    for j in range(SLOPES):
        phi[k] = 100.0 * steps[j] * (p - 0.5)
        k += 1
    for j in range(PLAYS.size):
        z[j] = max(x - PLAYS[j], min(x + PLAYS[j], z[j]))
        phi[k], phi[k + 1] = x - z[j], 2.0 * (p - 0.5) * (x - z[j])
        k += 2
    creep = 0.0
    for j in range(TAUS_S.size):
        low[j] += -math.expm1(-dt / TAUS_S[j]) * (p - low[j])
        phi[k] = p - low[j]
        creep += low[j]
        k += 1
    for j in range(SQUARE_TAUS_S.size):
        share, at = -math.expm1(-dt / SQUARE_TAUS_S[j]), TAUS_S.size + 2 * j
        low[at] += share * (phi[2] - low[at])
        low[at + 1] += share * (x - low[at + 1])
        phi[k], phi[k + 1] = phi[2] - low[at], x - low[at + 1]
        k += 2
    return creep


@njit(cache=True, nogil=True)
def _filter(
    e: float, base: float, w: Floats, cov: Floats, phi: Floats, gain: Floats,
    dt: float, learn: float, v: float,
) -> None:  # fmt: skip
    """Take one residual (already without the baseline) into the weights."""
    g = learn * min(1.0, 3.0 / math.sqrt(max(e * e / (base + v), 1e-12)))
    bound = base * max(1.0, TOGETHER_S / dt) + v
    for i in range(phi.size):
        share = g * gain[i] / bound
        w[i] += share * e
        for j in range(phi.size):
            cov[i, j] -= share * gain[j]
    # a random walk of this size is followed with a time constant of ZERO_S
    cov[0, 0] += learn * dt * max(dt, TOGETHER_S) / (ZERO_S * ZERO_S)


@njit(cache=True, nogil=True)
def _mean_sample(
    x: float, p: float, rate: float, e: float, at: int, dt: float, misfit2: float, w: Floats,
    cov: Floats, z: Floats, low: Floats, steps: Floats, floors: Floats, weights: Floats,
    now: Floats, block: Floats, phi: Floats, gain: Floats,
) -> None:  # fmt: skip
    """One sample of the slow part."""
    creep = _features(x, p, rate, dt, z, low, steps, now, phi)
    beyond = max(0.0, x - now[HIGHEST], now[LOWEST] - x)
    if beyond > 0.0:
        cov[0, 0] += (BEYOND * beyond) ** 2
        now[LOWEST], now[HIGHEST] = min(now[LOWEST], x), max(now[HIGHEST], x)
    if not math.isfinite(e):
        return
    block[B_RAW] += e
    block[B_RAW2] += e * e
    v = 0.0
    for i in range(phi.size):
        e -= w[i] * phi[i]
        gain[i] = _along(cov[i], phi)
        v += gain[i] * phi[i]
    base = _floor(floors, weights, WHOLE, at, misfit2)
    learn = now[LEARN]
    now[E_SMOOTH] += -math.expm1(-dt / SMOOTH_S) * (e - now[E_SMOOTH])
    ringing = (e - now[E_SMOOTH]) ** 2
    c = 1.0 / (base + v)
    block[B_W] += c
    block[B_P] += c * p
    block[B_C] += c * creep
    block[B_E] += c * e
    block[B_PP] += c * p * p
    block[B_PC] += c * p * creep
    block[B_CC] += c * creep * creep
    block[B_PE] += c * p * e
    block[B_CE] += c * creep * e
    block[B_N] += 1.0
    block[B_WHOLE] += min(e * e * c, LARGEST)
    block[B_RINGING] += min(ringing / (_floor(floors, weights, RINGING, at, misfit2) + v), LARGEST)
    if learn > 0.0:
        _learn(floors, weights, RINGING, at, ringing, learn, dt, now[MEMORY_S])
        _learn(floors, weights, WHOLE, at, e * e, learn, dt, now[MEMORY_S])
        _filter(e, base, w, cov, phi, gain, dt, learn, v)
    else:  # a zero that has moved is told, and then taken for the zero
        w[0] += dt / ZERO_S * e


@njit(cache=True, nogil=True)
def run(
    drive: Floats, predicted: Floats, measured: Floats, scale: Floats, hysteresis: Parts,
    plays: Floats, every: int, lag: int, dt: float, misfit2: float, w: Floats, cov: Floats,
    z: Floats, low: Floats, steps: Floats, floors: Floats, weights: Floats, past: Floats,
    now: Floats, block: Floats, phi: Floats, gain: Floats,
) -> int:  # fmt: skip
    """Samples until the sums of one second are complete, or the batch ends; how many were taken.

    measured: NaN where there is no fresh reading. scale: (drive low, range, predicted low, range,
    noise). hysteresis: the model's (r, b, k, c, u_offset), without thresholds where it has no
    rate terms; plays: its operators. The second is complete when now[BLOCK_S] >= 1.
    """
    for i in range(drive.size):
        x, p = (drive[i] - scale[0]) / scale[1], (predicted[i] - scale[2]) / scale[3]
        e = (measured[i] - predicted[i]) / scale[4]
        if now[FILLED] == 0.0:
            now[FILLED] = 1.0
            now[P_BEFORE], now[X_BEFORE], now[X_MEAN] = p, x, x
            now[LOWEST] = now[HIGHEST] = x
            low[: TAUS_S.size] = p
            for j in range(TAUS_S.size, N_LOW, 2):
                low[j], low[j + 1] = 2.0 * (p - 0.5) ** 2, x
        step = x - now[X_BEFORE]
        rate_part = 0.0
        if plays.size:
            rate_part = _rate_part(hysteresis, plays, drive[i], step * scale[1] / dt) / scale[4]
            now[SUM_RATE] += rate_part
        jerk = abs(step - now[STEP_BEFORE]) / (dt * dt)
        speed = abs(p - now[P_BEFORE]) / dt
        now[X_BEFORE], now[STEP_BEFORE], now[P_BEFORE] = x, step, p
        now[SPEED] = max(speed, now[SPEED] * math.exp(-dt / SPEED_HELD_S))
        now[JERK] = max(jerk, now[JERK] * math.exp(-dt / JERK_HELD_S))
        at = np.searchsorted(SPEEDS, now[SPEED]) * (JERKS.size + 1)
        at += np.searchsorted(JERKS, now[JERK])
        place = int(now[COUNT]) % past.size
        before = past[(place - lag) % past.size]
        past[place] = e - w[3] * rate_part
        if math.isfinite(e) and math.isfinite(before):
            square = 0.5 * (past[place] - before) ** 2
            share = square / _floor(floors, weights, SHORT, at, misfit2)
            block[B_SHORT] += min(share, LARGEST)
            block[B_NSHORT] += 1.0
            if now[LEARN] > 0.0:
                _learn(floors, weights, SHORT, at, square, now[LEARN], dt, now[MEMORY_S])
        now[COUNT] += 1.0
        now[SUM_X] += x
        now[SUM_P] += p
        if math.isfinite(e):
            now[SUM_E] += e
            now[KNOWN] += 1.0
        now[CLASS] = max(now[CLASS], float(at))
        if int(now[COUNT]) % every == 0:
            mean = now[SUM_E] / now[KNOWN] if now[KNOWN] > 0.0 else math.nan
            _mean_sample(
                now[SUM_X] / every, now[SUM_P] / every, now[SUM_RATE] / every, mean,
                int(now[CLASS]), dt * every, misfit2, w, cov, z, low, steps, floors, weights, now,
                block, phi, gain,
            )  # fmt: skip
            now[SUM_X] = now[SUM_P] = now[SUM_E] = now[KNOWN] = now[CLASS] = now[SUM_RATE] = 0.0
        if measured[i] == now[LAST_Y]:
            now[STILL_S] += dt
            now[STILL_LOW] = min(now[STILL_LOW], p)
            now[STILL_HIGH] = max(now[STILL_HIGH], p)
        elif math.isfinite(measured[i]):
            now[LAST_Y], now[STILL_S] = measured[i], 0.0
            now[STILL_LOW] = now[STILL_HIGH] = p
        now[BLOCK_S] += dt
        if now[BLOCK_S] >= 1.0:
            return i + 1
    return drive.size
