"""Plan or static inverse: both run ahead from the same state over the known part of the window.

Both are followed sample by sample with the model itself, the limits of drive and rate included. The
plan pays for what it would cost to become the static inverse from there (terminal cost). It is used
where, up to one of a few places along the window,

    sqrt(cost of the plan) <= sqrt(cost of the static inverse) + allowance * noise * sqrt(samples)

and is taken up again where it promises clearly less. A drive that comes from a plan stands some
way off the static inverse's, its gap. Giving it up in one sample is a kick of gap * lag, the rate
term's lag in samples; letting it fade by lag / (1 + lag) a sample is none.
"""

import math

from numba import njit

from dehyst.models.hysteresis.forward import polynomial
from dehyst.models.hysteresis.operators import move
from dehyst.models.hysteresis.saturation import slope
from dehyst.models.inverse.state import Inverse
from dehyst.models.inverse.static import inverse_step
from dehyst.models.inverse.tuning import TUNING
from dehyst.models.inverse.window import between
from dehyst.models.model import Floats

GONE = 1e-5  # of the drive range: a gap that is over


@njit(cache=True, nogil=True)
def limited(inv: Inverse, u: float, last: float) -> float:
    """u within rate and range."""
    setting, limits = inv.setting[0], inv.static.limits[0]
    travel = setting.rate * setting.period
    return min(max(u, last - travel, limits.low), last + travel, limits.high)


@njit(cache=True, nogil=True)
def run_on(inv: Inverse, h: Floats, last: float, u: float) -> tuple[float, float]:
    """Displacement when the drive goes from `last` to u, and the rate term's lag there in samples;
    negative where the displacement first runs the wrong way. The plays h (n,) are advanced."""
    setting, c = inv.setting[0], inv.hysteresis.c
    z, kh = move(inv.hysteresis.weights, h, u - inv.hysteresis.u_offset[0])
    steep = slope(c, z)
    z += kh * (u - last) / setting.period
    lag = setting.sense * kh * steep / (setting.period * setting.slope)
    return polynomial(c, z), min(max(lag, -1e6), 1e6)


@njit(cache=True, nogil=True)
def lag_now(inv: Inverse) -> float:
    """The rate term's lag where the stage is, in samples."""
    setting, hysteresis = inv.setting[0], inv.hysteresis
    z, kh = 0.0, 0.0
    for i in range(inv.plays.size):
        z += hysteresis.weights[1, i] * inv.plays[i]
        kh += hysteresis.weights[2, i] * inv.plays[i]
    lag = setting.sense * kh * slope(hysteresis.c, z) / (setting.period * setting.slope)
    return min(max(lag, -1e6), 1e6)


@njit(cache=True, nogil=True)
def fading(lag: float) -> float:
    """What is left of a gap after a sample."""
    return abs(lag) / (1.0 + abs(lag))


@njit(cache=True, nogil=True)
def handover(off: float, lag: float, miss: float) -> float:
    """Squared error that a gap adds while it fades; off: the gap as a displacement; miss: the
    static inverse's error meanwhile.

    With a lag the fading drive's rate term and its offset cancel. With a negative one they add up
    to 2 lag / (1 + lag) off, which falls as the gap does.
    """
    if lag >= 0.0:
        return 0.0
    lag = -lag
    return max(4.0 * lag * off * miss + 4.0 * lag * lag / (1.0 + 2.0 * lag) * off * off, 0.0)


@njit(cache=True, nogil=True)
def gap_of(inv: Inverse, h: Floats, last: float, target: float) -> float:
    """How far the drive `last` is from the static inverse's for the same target."""
    if not math.isfinite(target):
        return 0.0
    home, _ = inverse_step(inv.static, h, last, target)
    return last - home


@njit(cache=True, nogil=True)
def approach(inv: Inverse, target: float) -> float:
    """The static inverse's drive with what is left of the gap."""
    limits, state = inv.static.limits[0], inv.state[0]
    home, _ = inverse_step(inv.static, inv.plays, state.last, target)
    if state.gap != 0.0:
        state.gap *= fading(lag_now(inv))
        if abs(state.gap) < GONE * (limits.high - limits.low):
            state.gap = 0.0
    return limited(inv, home + state.gap, state.last)


@njit(cache=True, nogil=True)
def _line(ahead: Floats, known: int, at: float) -> float:
    """Target at any position among the known ones."""
    i = min(int(at + 1e-9), known - 1)
    q = at - i
    if q < 1e-6 or i + 1 >= known:
        return ahead[i]
    return ahead[i] + q * (ahead[i + 1] - ahead[i])


@njit(cache=True, nogil=True)
def _pays(inv: Inverse, share: float, noise: float) -> bool:
    """Whether the plan costs no more than `share` of the static inverse and the noise, from the
    present state up to one of LOOKS places along the known part of the window."""
    setting, state = inv.setting[0], inv.state[0]
    x, h, h_static = inv.plan, inv.ahead_plays, inv.static_plays
    h[:], h_static[:] = inv.plays, inv.plays
    per_node, late = setting.per_node, setting.late
    u, v, gap, lag, y = state.last, state.last, state.gap, lag_now(inv), 0.0
    lag_static, cost, other, miss = lag, 0.0, 0.0, 0.0
    x_0, slope_0 = state.x_0, state.slope_0
    undone = inv.nodes.target[0] - _line(inv.ahead, state.known, late + per_node - 1.0)
    look = max(x.size // TUNING.looks, 1)
    for j in range(state.nodes):
        slope_1 = 0.5 * ((x[j + 1] if j + 1 < x.size else x[j]) - x_0)
        end = late + (j + 1.0) * per_node - 1.0
        before, undone = undone, inv.nodes.target[j] - _line(inv.ahead, state.known, end)
        for i in range(per_node):
            q = (i + 1.0) / per_node
            y = _line(inv.ahead, state.known, end - per_node + 1.0 + i)
            y += before + q * (undone - before)
            was = u
            u = limited(inv, between(x_0, x[j], slope_0, slope_1, q), was)
            got, lag = run_on(inv, h, was, u)
            cost += (got - y) * (got - y)
            was = v
            home, _ = inverse_step(inv.static, h_static, was, y)
            gap *= fading(lag_static)
            v = limited(inv, home + gap, was)
            got, lag_static = run_on(inv, h_static, was, v)
            miss = got - y
            other += miss * miss
        x_0, slope_0 = x[j], slope_1
        if (j + 1) % look == 0:
            off = setting.sense * setting.slope * gap_of(inv, h, u, y)
            most = share * math.sqrt(other) + noise * math.sqrt((j + 1.0) * per_node)
            if cost + handover(off, lag, miss) <= most * most:
                return True
    return False


@njit(cache=True, nogil=True)
def choose(inv: Inverse, error: float) -> None:
    """Whether the plan is followed from this node on; error: its squared error at the nodes."""
    setting, state = inv.setting[0], inv.state[0]
    noise, share = TUNING.allowance * setting.noise, TUNING.gain
    if state.followed != 0:
        if error <= state.nodes * noise * noise:
            return  # within the noise whatever the static inverse would do
        state.gap = gap_of(inv, inv.plays, state.last, state.target_before)
        share = 1.0
    enough = state.nodes >= max(inv.plan.size // TUNING.looks, 1)
    state.followed = 1 if enough and _pays(inv, share, noise) else 0
