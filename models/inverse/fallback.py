"""Decide between the plan and the static inverse by simulating both over the known targets.

Both are simulated from the same state, sample by sample with the model itself and with the limits
of drive and rate. The plan is followed up to one of a few places along the window, and the static
inverse takes over from there to the next place: the cost of that part is the plan's terminal cost.
The plan is used where, for one of the places,

    sqrt(cost of both) <= sqrt(cost of the static inverse alone) + allowance * noise * sqrt(samples)

and a plan that was given up is used again where it predicts a clearly lower cost. The drive of a
plan differs from the static inverse's by a gap. Dropping the gap in one sample kicks the stage by
gap * lag, with the rate term's lag in samples; a gap that fades by the factor lag / (1 + lag) per
sample does not.
"""

import math

import numpy as np
from numba import njit

from dehyst.models.hysteresis.forward import polynomial
from dehyst.models.hysteresis.operators import move
from dehyst.models.hysteresis.saturation import slope
from dehyst.models.inverse.state import Inverse
from dehyst.models.inverse.static import inverse_step
from dehyst.models.inverse.tuning import TUNING
from dehyst.models.inverse.window import between
from dehyst.models.model import Floats


@njit(cache=True, nogil=True, inline="always")
def limited(inv: Inverse, u: float, last: float, samples: int) -> float:
    """Return u limited in rate and range, `samples` samples after `last`."""
    setting, limits = inv.setting[0], inv.static.limits[0]
    travel = setting.rate * setting.period * samples
    return min(max(u, last - travel, limits.low), last + travel, limits.high)


@njit(cache=True, nogil=True, inline="always")
def _run_on(inv: Inverse, h: Floats, last: float, u: float, samples: int) -> float:
    """Return the displacement when the drive goes from `last` to u in `samples` samples. The plays
    h (n,) are advanced."""
    z, kh = move(inv.hysteresis.weights, h, u - inv.hysteresis.u_offset[0])
    return polynomial(inv.hysteresis.c, z + kh * (u - last) / (samples * inv.setting[0].period))


@njit(cache=True, nogil=True, inline="always")
def _faded(inv: Inverse, h: Floats, gap: float, samples: int) -> float:
    """Return the rest of a gap after `samples` samples, from the lag at the plays h (n,)."""
    setting, hysteresis, limits = inv.setting[0], inv.hysteresis, inv.static.limits[0]
    if gap == 0.0:
        return 0.0
    z, kh = 0.0, 0.0
    for i in range(h.size):
        z += hysteresis.weights[1, i] * h[i]
        kh += hysteresis.weights[2, i] * h[i]
    lag = min(abs(kh * slope(hysteresis.c, z)) / (setting.period * setting.slope), 1e6)
    left = gap * (lag / (samples + lag))
    return left if abs(left) >= TUNING.gone * (limits.high - limits.low) else 0.0


@njit(cache=True, nogil=True, inline="always")
def gap_of(inv: Inverse, h: Floats, last: float, target: float) -> float:
    """Return the drive `last` minus the static inverse's drive for the same target."""
    if not math.isfinite(target):
        return 0.0
    home, _ = inverse_step(inv.static, h, last, target)
    return last - home


@njit(cache=True, nogil=True)
def approach(inv: Inverse, target: float) -> float:
    """Return the static inverse's drive plus the rest of the gap."""
    state = inv.state[0]
    home, _ = inverse_step(inv.static, inv.plays, state.last, target)
    state.gap = _faded(inv, inv.plays, state.gap, 1)
    return limited(inv, home + state.gap, state.last, 1)


@njit(cache=True, nogil=True)
def _line(ahead: Floats, known: int, at: float) -> float:
    """Return the target at any position among the known ones."""
    i = min(int(at + 1e-9), known - 1)
    q = at - i
    if q < 1e-6 or i + 1 >= known:
        return ahead[i]
    return ahead[i] + q * (ahead[i + 1] - ahead[i])


@njit(cache=True, nogil=True, inline="always")
def _asked(inv: Inverse, j: int, i: int) -> float:
    """Return the displacement required of the hysteresis at sample i of the interval that ends at
    node j: the target there plus the blocks' correction, interpolated from the nodes."""
    setting, state, target = inv.setting[0], inv.state[0], inv.nodes.target
    per_node, known = setting.per_node, state.known
    end = setting.late + (j + 1.0) * per_node - 1.0
    after = target[j] - _line(inv.ahead, known, end)
    before = after if j == 0 else target[j - 1] - _line(inv.ahead, known, end - per_node)
    q = (i + 1.0) / per_node
    return _line(inv.ahead, known, end - per_node + 1.0 + i) + before + q * (after - before)


@njit(cache=True, nogil=True)
def _plan_ahead(
    inv: Inverse, h: Floats, u: float, stride: int, first: int, end: int
) -> tuple[float, float]:
    """Return the plan's squared error from node `first` to `end`, every `stride` samples, and its
    last drive. u: the drive before; the plays h (n,) at u are advanced."""
    state, x, per_node = inv.state[0], inv.plan, inv.setting[0].per_node
    cost = 0.0
    for j in range(first, end):
        x_0 = x[j - 1] if j > 0 else state.x_0
        before = x[j - 2] if j > 1 else state.x_0
        slope_0 = 0.5 * (x[j] - before) if j > 0 else state.slope_0
        slope_1 = 0.5 * ((x[j + 1] if j + 1 < x.size else x[j]) - x_0)
        for i in range(stride - 1, per_node, stride):
            was, q = u, (i + 1.0) / per_node
            u = limited(inv, between(x_0, x[j], slope_0, slope_1, q), was, stride)
            miss = _run_on(inv, h, was, u, stride) - _asked(inv, j, i)
            cost += miss * miss
    return cost, u


@njit(cache=True, nogil=True)
def _static_ahead(
    inv: Inverse, h: Floats, u: float, gap: float, stride: int, first: int, end: int
) -> tuple[float, float, float]:
    """Return the squared error of the static inverse from node `first` to `end` while a gap fades,
    its last drive and the last gap; h as in `_plan_ahead`."""
    cost = 0.0
    for j in range(first, end):
        for i in range(stride - 1, inv.setting[0].per_node, stride):
            was, y = u, _asked(inv, j, i)
            home, _ = inverse_step(inv.static, h, was, y)
            gap = _faded(inv, h, gap, stride)
            u = limited(inv, home + gap, was, stride)
            miss = _run_on(inv, h, was, u, stride) - y
            cost += miss * miss
    return cost, u, gap


@njit(cache=True, nogil=True)
def _pays(inv: Inverse, share: float, noise: float, stride: int) -> bool:
    """Return whether the plan up to one of `looks` places along the known part of the window, with
    the static inverse from there to the next place, costs at most `share` of the static inverse
    from the present state, plus the noise. stride: spacing of the samples that are compared."""
    setting, state = inv.setting[0], inv.state[0]
    look = max(inv.plan.size // TUNING.looks, 1)
    h, h_static, h_after = inv.ahead_plays, inv.static_plays, inv.after_plays
    h[:], h_static[:] = inv.plays, inv.plays
    u, v, gap, cost, other = state.last, state.last, state.gap, 0.0, 0.0
    begin = np.int64(0)  # a plain 0 has a type of its own: its callees would compile twice
    while begin + look < state.nodes:
        end = begin + look
        after = min(end + look, state.nodes)
        if begin == 0:
            other, v, gap = _static_ahead(inv, h_static, v, gap, stride, begin, end)
        more, u = _plan_ahead(inv, h, u, stride, begin, end)
        cost += more
        more, v, gap = _static_ahead(inv, h_static, v, gap, stride, end, after)
        other += more
        h_after[:] = h
        off = gap_of(inv, h, u, _asked(inv, end - 1, setting.per_node - 1))
        back, _, _ = _static_ahead(inv, h_after, u, off, stride, end, after)
        most = share * math.sqrt(other) + noise * math.sqrt(after * setting.per_node / stride)
        if cost + back <= most * most:
            return True
        begin = end
    return False


@njit(cache=True, nogil=True)
def _is_off(inv: Inverse) -> bool:
    """Return whether the static inverse from the present state will miss by more than the noise."""
    setting, state, h, begin = inv.setting[0], inv.state[0], inv.static_plays, np.int64(0)
    h[:] = inv.plays
    end = min(max(inv.plan.size // TUNING.looks, 1), state.nodes)
    cost, _, _ = _static_ahead(inv, h, state.last, state.gap, setting.per_node, begin, end)
    return bool(cost > end * (TUNING.clear * setting.noise) ** 2)


@njit(cache=True, nogil=True)
def choose_drive(inv: Inverse, error: float) -> None:
    """Decide whether the plan is followed from this node on. error: its squared error at the nodes;
    while it is within the noise, only the nodes are compared."""
    setting, state, share, stride, pays = inv.setting[0], inv.state[0], TUNING.gain, 1, False
    noise = TUNING.allowance * setting.noise
    if state.followed != 0:
        state.gap = gap_of(inv, inv.plays, state.last, state.target_before)
        share = 1.0
        if error <= state.nodes * noise * noise:
            stride = setting.per_node
            # a plan that covers the rest of the window is followed to its end
            pays = state.nodes <= inv.plan.size // TUNING.looks or _is_off(inv)
    state.followed = 1 if pays or _pays(inv, share, noise, stride) else 0
