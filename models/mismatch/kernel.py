"""The monitor's arithmetic, sample by sample: baseline filter, noise floors, sums of one second.

See dehyst.models.mismatch.monitor for the meaning. x: drive, p: predicted displacement, both as
shares of their range; e: residual in units of the model's noise.
"""

import math
from typing import NamedTuple

import numpy as np
from numba import njit
from numpy.typing import NDArray

from dehyst.models.hysteresis.forward import polynomial
from dehyst.models.hysteresis.play import play_step
from dehyst.models.mismatch.tuning import TUNING
from dehyst.models.model import Floats

PLAYS = np.array([0.005, 0.01, 0.02, 0.035, 0.055, 0.08, 0.11, 0.15, 0.2, 0.26, 0.33, 0.42])
TAUS_S = np.array([0.03, 0.1, 0.3, 1.0, 3.0, 10.0, 30.0, 100.0, 300.0, 1000.0])
SQUARE_TAUS_S = np.array([0.03, 0.3, 3.0, 30.0, 300.0])  # for p^2 and for the drive
N_LOW = TAUS_S.size + 2 * SQUARE_TAUS_S.size
N_FEATURES = 4 + TUNING.steps + TUNING.slopes + 2 * PLAYS.size + N_LOW

# Classes of motion: speed [ranges / s] and change of speed [ranges / s^2], each held briefly.
SPEEDS = np.array([0.003, 0.03, *np.geomspace(0.1, 12.8, 15)])
JERKS = np.array([4.0, 40.0, 120.0, 400.0, 1200.0])
N_CLASSES = (SPEEDS.size + 1) * (JERKS.size + 1)
WHOLE, RINGING, SHORT = range(3)  # rows of floors and weights


def _record(*names: str) -> np.dtype:
    return np.dtype([(name, np.float64) for name in names])


NOW = _record(
    "filled",
    "x_before",
    "p_before",
    "step_before",
    "speed",
    "jerk",
    "count",
    "sum_x",
    "sum_p",
    "sum_e",
    "known",
    "motion_class",
    "x_mean",
    "e_smooth",
    "second_s",
    "last_y",
    "still_s",
    "still_low",
    "still_high",
    "learn",
    "sum_rate",
    "memory_s",
    "lowest",
    "highest",
    "raw_lowest",
    "raw_highest",
)
# Sums of one second. w: their weights; c: the creep direction; n_raw: samples of raw and raw2,
# which restart (raw_anew) where the drive goes beyond its earlier range.
SUMS = _record(
    "w",
    "p",
    "c",
    "e",
    "pp",
    "pc",
    "cc",
    "pe",
    "ce",
    "n",
    "whole",
    "ringing",
    "n_short",
    "short",
    "raw",
    "raw2",
    "n_raw",
    "raw_anew",
)


class Plant(NamedTuple):
    """Constants. scale: (drive low, range, predicted low, range, noise); r, b, k, c, offset: the
    model's hysteresis, without thresholds where it has no rate terms; every, lag: samples of the
    filter and of the short differences; dt: [s]; misfit2: the model's own, in noises squared."""

    scale: Floats
    r: Floats
    b: Floats
    k: Floats
    c: Floats
    offset: float
    every: int
    lag: int
    dt: float
    misfit2: float


class MonitorState(NamedTuple):
    """State that the samples change. w, cov: baseline and its covariance; plays: the model's
    operators; z, low, steps: operators, low passes and newest steps of the features; floors,
    weights: (3, N_CLASSES) mean squares and how long they were learned; past: residuals for the
    short differences; now: (1,) of NOW; sums: (1,) of SUMS; phi, gain: scratch."""

    w: Floats
    cov: Floats
    plays: Floats
    z: Floats
    low: Floats
    steps: Floats
    floors: Floats
    weights: Floats
    past: Floats
    now: NDArray[np.void]
    sums: NDArray[np.void]
    phi: Floats
    gain: Floats


@njit(cache=True, nogil=True)
def _expect(state: MonitorState, row: int, at: int, misfit2: float) -> float:
    """Return the expected mean square in a class of motion; until it is known, the model's own
    figure."""
    known = state.weights[row, at]
    trust_s = TUNING.trust_s
    return max((state.floors[row, at] * known + trust_s * misfit2) / (known + trust_s), 0.7)


@njit(cache=True, nogil=True)
def _learn(state: MonitorState, row: int, at: int, square: float, dt: float) -> None:
    """Update the mean square of a class; single large values count little."""
    learn, memory_s = state.now[0].learn, state.now[0].memory_s
    floors, weights = state.floors, state.weights
    weights[row, at] = min(weights[row, at] + learn * dt, memory_s)
    share = min(1.0, learn * dt / max(weights[row, at], dt))
    floors[row, at] += share * (min(square, 9.0 * floors[row, at]) - floors[row, at])


@njit(cache=True, nogil=True, fastmath=True)
def _multiply(a: Floats, b: Floats) -> float:
    """Return the inner product, summed in any order."""
    s = 0.0
    for j in range(a.size):
        s += a[j] * b[j]
    return s


@njit(cache=True, nogil=True)
def _split_rate_part(plant: Plant, h: Floats, drive: float, rate: float) -> float:
    """Return the part of the model's displacement that comes from its rate terms; h is advanced in
    place."""
    play_step(plant.r, h, drive - plant.offset)
    still = _multiply(plant.b, h)
    moving = polynomial(plant.c, still + rate * _multiply(plant.k, h))
    return moving - polynomial(plant.c, still)


@njit(cache=True, nogil=True)
def _fill_features(state: MonitorState, x: float, p: float, rate: float, dt: float) -> float:
    """Fill phi and return the creep direction."""
    phi, steps, z, low, now = state.phi, state.steps, state.z, state.low, state.now[0]
    phi[0], phi[1], phi[2], phi[3] = 1.0, p - 0.5, 2.0 * (p - 0.5) ** 2, rate
    for j in range(TUNING.steps - 1, 0, -1):
        steps[j] = steps[j - 1]
    steps[0] = x - now.x_mean
    now.x_mean = x
    k = 4
    for j in range(TUNING.steps):
        phi[k] = 50.0 * steps[j]
        k += 1
    for j in range(TUNING.slopes):
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
def _correct(state: MonitorState, e: float, base: float, v: float, dt: float) -> None:
    """Update the weights with one residual (already without the baseline)."""
    w, cov, gain, learn = state.w, state.cov, state.gain, state.now[0].learn
    g = learn * min(1.0, 3.0 / math.sqrt(max(e * e / (base + v), 1e-12)))
    bound = base * max(1.0, TUNING.together_s / dt) + v
    for i in range(w.size):
        share = g * gain[i] / bound
        w[i] += share * e
        for j in range(w.size):
            cov[i, j] -= share * gain[j]
    # a random walk of this size is tracked with a time constant of zero_s
    cov[0, 0] += learn * dt * max(dt, TUNING.together_s) / (TUNING.zero_s * TUNING.zero_s)


@njit(cache=True, nogil=True)
def _take_mean(
    plant: Plant, state: MonitorState, x: float, p: float, rate: float, e: float
) -> None:
    """Process one sample of the slow part: means over `every` samples."""
    now, s, phi = state.now[0], state.sums[0], state.phi
    dt, at = plant.dt * plant.every, int(now.motion_class)
    creep = _fill_features(state, x, p, rate, dt)
    beyond = max(0.0, x - now.highest, now.lowest - x)
    if beyond > 0.0:
        state.cov[0, 0] += (TUNING.beyond * beyond) ** 2
        now.lowest, now.highest = min(now.lowest, x), max(now.highest, x)
    if x > now.raw_highest + TUNING.farther or x < now.raw_lowest - TUNING.farther:
        now.raw_lowest, now.raw_highest = min(now.raw_lowest, x), max(now.raw_highest, x)
        s.raw = s.raw2 = s.n_raw = 0.0
        s.raw_anew = 1.0
    if not math.isfinite(e):
        return
    s.raw += e
    s.raw2 += e * e
    s.n_raw += 1.0
    v = 0.0
    for i in range(phi.size):
        e -= state.w[i] * phi[i]
        state.gain[i] = _multiply(state.cov[i], phi)
        v += state.gain[i] * phi[i]
    base = _expect(state, WHOLE, at, plant.misfit2)
    now.e_smooth += -math.expm1(-dt / TUNING.smooth_s) * (e - now.e_smooth)
    ringing = (e - now.e_smooth) ** 2
    c = 1.0 / (base + v)
    s.w += c
    s.p += c * p
    s.c += c * creep
    s.e += c * e
    s.pp += c * p * p
    s.pc += c * p * creep
    s.cc += c * creep * creep
    s.pe += c * p * e
    s.ce += c * creep * e
    s.n += 1.0
    s.whole += min(e * e * c, TUNING.largest)
    s.ringing += min(ringing / (_expect(state, RINGING, at, plant.misfit2) + v), TUNING.largest)
    if now.learn > 0.0:
        _learn(state, RINGING, at, ringing, dt)
        _learn(state, WHOLE, at, e * e, dt)
        _correct(state, e, base, v, dt)
    else:  # a zero that has moved is reported, and then becomes the new zero
        state.w[0] += dt / TUNING.zero_s * e


@njit(cache=True, nogil=True)
def _begin(state: MonitorState, x: float, p: float) -> None:
    """Initialise with the first sample: all low passes settled."""
    now, low = state.now[0], state.low
    now.filled = 1.0
    now.p_before, now.x_before, now.x_mean = p, x, x
    now.lowest = now.highest = now.raw_lowest = now.raw_highest = x
    low[: TAUS_S.size] = p
    for j in range(TAUS_S.size, N_LOW, 2):
        low[j], low[j + 1] = 2.0 * (p - 0.5) ** 2, x


@njit(cache=True, nogil=True)
def _take_short(plant: Plant, state: MonitorState, e: float, at: int) -> None:
    """Process the difference from the residual `lag` samples before; e: without the rate part."""
    now, sums, past = state.now[0], state.sums[0], state.past
    place = int(now.count) % past.size
    before = past[(place - plant.lag) % past.size]
    past[place] = e
    if math.isfinite(e) and math.isfinite(before):
        square = 0.5 * (e - before) ** 2
        sums.short += min(square / _expect(state, SHORT, at, plant.misfit2), TUNING.largest)
        sums.n_short += 1.0
        if now.learn > 0.0:
            _learn(state, SHORT, at, square, plant.dt)


@njit(cache=True, nogil=True)
def watch_sample(
    plant: Plant, state: MonitorState, drive: Floats, predicted: Floats, measured: Floats
) -> int:
    """Process samples until the sums of one second are complete, or the batch ends; return how many
    were taken.

    measured: NaN where there is no fresh reading. The second is complete when second_s >= 1.
    """
    now, scale, dt, every = state.now[0], plant.scale, plant.dt, plant.every
    for i in range(drive.size):
        x, p = (drive[i] - scale[0]) / scale[1], (predicted[i] - scale[2]) / scale[3]
        e = (measured[i] - predicted[i]) / scale[4]
        if now.filled == 0.0:
            _begin(state, x, p)
        step = x - now.x_before
        rate_part = 0.0
        if state.plays.size:
            rate = step * scale[1] / dt
            rate_part = _split_rate_part(plant, state.plays, drive[i], rate) / scale[4]
            now.sum_rate += rate_part
        jerk = abs(step - now.step_before) / (dt * dt)
        speed = abs(p - now.p_before) / dt
        now.x_before, now.step_before, now.p_before = x, step, p
        now.speed = max(speed, now.speed * math.exp(-dt / TUNING.speed_held_s))
        now.jerk = max(jerk, now.jerk * math.exp(-dt / TUNING.jerk_held_s))
        at = np.searchsorted(SPEEDS, now.speed) * (JERKS.size + 1)
        at += np.searchsorted(JERKS, now.jerk)
        _take_short(plant, state, e - state.w[3] * rate_part, at)
        now.count += 1.0
        now.sum_x += x
        now.sum_p += p
        if math.isfinite(e):
            now.sum_e += e
            now.known += 1.0
        now.motion_class = max(now.motion_class, float(at))
        if int(now.count) % every == 0:
            mean = now.sum_e / now.known if now.known > 0.0 else math.nan
            _take_mean(
                plant, state, now.sum_x / every, now.sum_p / every, now.sum_rate / every, mean
            )
            now.sum_x = now.sum_p = now.sum_e = now.known = now.motion_class = now.sum_rate = 0.0
        if measured[i] == now.last_y:
            now.still_s += dt
            now.still_low = min(now.still_low, p)
            now.still_high = max(now.still_high, p)
        elif math.isfinite(measured[i]):
            now.last_y, now.still_s = measured[i], 0.0
            now.still_low = now.still_high = p
        now.second_s += dt
        if now.second_s >= 1.0:
            return i + 1
    return drive.size
