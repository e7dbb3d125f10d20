"""The parts of the simulated stage as compiled kernels; kernels.py runs them in this order:

command -> DAC step -> + gain x EXT -> clip -> amplifier lag -> 60 mA slew -> RC
        -> hysteresis -> creep -> mechanical mode -> guide friction
        -> temperature, drift, coupling, other axes, hum -> bridge filter -> delay -> noise -> ADC
"""

import math
from typing import Any

import numpy as np
from numba import njit
from numpy.typing import NDArray

from dehyst.drivers.simulated.settings import STAGE_KEYS
from dehyst.models.arrays import Floats

Record = Any  # numba indexes a (1,) structured array; the scalar has attributes

# seed and hysteresis_width are used only when the stage is built; the other settings, and:
DERIVED = ("creep_static", "norm", "substep_s", "quiet_s")
PARAMETERS = tuple(key for key in STAGE_KEYS if key not in ("seed", "hysteresis_width")) + DERIVED
STATE = (
    "time_s",
    "command_v",  # the present inputs: command, EXT, the other axis, the temperature
    "ext_v",
    "other_v",
    "temperature_k",
    "clipped",  # 1 while the sum of command and EXT is outside the clip range
    "amplifier_v",  # after the amplifier's lag
    "source_v",  # after the slew limit
    "drive_v",  # at the piezo
    "rate",  # filtered |drive rate|, ranges per second
    "slip",  # mechanical, as shares of the stroke: sum of the springs,
    "strain",  # after the static map,
    "creep",  # with creep,
    "mode",  # the mode's own coordinate
    "mode_rate",
    "friction",  # um, after the guide
    "moved_um",  # from the origin, by this axis' own piezo: what moves the other axes
    "others_um",  # contribution of the other axes, before the platform's mode,
    "swing",  # the mode's coordinate
    "swing_rate",
    "cross_um",  # and after it
    "shift_um",  # keeps the displacement unchanged when settings change
    "true_um",
    "bridge_um",  # after the bridge's filter
    "pushed_s",  # time of the newest entry of the delay line
    "spare_normal",
    "has_spare",
)
PARAMETERS_T = np.dtype([(name, np.float64) for name in PARAMETERS])
STATE_T = np.dtype([(name, np.float64) for name in STATE])

# Relaxations of the creep operator: log-spaced time constants, the first well below 0.1 s.
CREEP_PER_DECADE = 3
CREEP_TAUS_S = 10.0 ** np.arange(-2.0, 4.51, 1.0 / CREEP_PER_DECADE)
RING = 8192  # samples of the delay line


@njit(cache=True, nogil=True)
def quantised(value: float, step: float) -> float:
    """Round to the nearest multiple of step; step 0: return the value itself."""
    return value if step == 0.0 else step * np.round(value / step)


@njit(cache=True, nogil=True)
def electrical(
    p: Record, s: Record, command_v: float, h: float, rc_decay: float, amplifier_decay: float
) -> None:
    """Advance DAC, EXT, clip, amplifier lag, slew and RC by h seconds: updates s."""
    wanted = quantised(command_v, p.dac_step_v) + p.ext_gain * s.ext_v
    limited = min(p.clip_max_v, max(p.clip_min_v, wanted))
    s.clipped = 1.0 if limited != wanted else 0.0
    s.amplifier_v = limited + (s.amplifier_v - limited) * amplifier_decay
    move = s.amplifier_v - s.source_v
    ramp_s = 0.0
    if p.slew_v_per_s > 0.0:
        ramp_s = min(h, abs(move) / p.slew_v_per_s)
        move = math.copysign(p.slew_v_per_s * ramp_s, move)
        if ramp_s < h:
            move = s.amplifier_v - s.source_v
    start = s.source_v
    s.source_v = s.amplifier_v if ramp_s < h else start + move
    tau = p.rc_tau_s
    if tau == 0.0:
        s.drive_v = s.source_v
        return
    if ramp_s > 0.0:  # the capacitor follows a ramp tau late, then relaxes to its end value
        late = move / ramp_s * tau
        s.drive_v = s.source_v - late + (s.drive_v - start + late) * math.exp(-ramp_s / tau)
        rc_decay = math.exp(-(h - ramp_s) / tau)
    s.drive_v = s.source_v + (s.drive_v - s.source_v) * rc_decay


@njit(cache=True, nogil=True)
def mode_factors(hz: float, damping: float, h: float) -> tuple[float, float, float, float]:
    """Return the transition of a mode's free motion over h seconds: a11, a12, a21, a22."""
    w = 2.0 * math.pi * hz
    wd = w * math.sqrt(1.0 - damping**2)
    fade = math.exp(-damping * w * h)
    c, sn = math.cos(wd * h), math.sin(wd * h)
    ratio = damping * w / wd
    return (
        fade * (c + ratio * sn),
        fade * sn / wd,
        -fade * sn * w * w / wd,
        fade * (c - ratio * sn),
    )


@njit(cache=True, nogil=True)
def cross(p: Record, s: Record, h: float) -> None:
    """Advance the other axes' contribution by h seconds; s.others_um is held meanwhile."""
    if p.cross_share > 0.0 and p.cross_hz > 0.0:
        a11, a12, a21, a22 = mode_factors(p.cross_hz, p.cross_damping, h)
        off, rate = s.swing - s.others_um, s.swing_rate
        s.swing = s.others_um + a11 * off + a12 * rate
        s.swing_rate = a21 * off + a22 * rate
        s.cross_um = s.others_um + p.cross_share * (s.swing - s.others_um)
    else:
        s.cross_um = s.swing = s.others_um
        s.swing_rate = 0.0


@njit(cache=True, nogil=True)
def displacement(p: Record, s: Record) -> float:
    """Return the true displacement [um] from the present state; updates the guide's friction."""
    share = p.mode_share if p.mode_hz > 0.0 else 0.0
    moved = p.stroke_um * ((1.0 - share) * s.creep + share * s.mode)
    s.friction = max(moved - p.friction_um, min(moved + p.friction_um, s.friction))
    warm = s.temperature_k
    s.moved_um = s.friction * (1.0 + p.gain_per_k * warm)
    y = p.origin_um + s.moved_um + p.expansion_um_per_k * warm + s.cross_um
    y += p.drift_um_per_s * s.time_s + p.coupling_um_per_v * s.other_v
    if p.hum_um > 0.0:
        y += p.hum_um * math.sin(2.0 * math.pi * p.hum_hz * s.time_s)
    return y + s.shift_um


@njit(cache=True, nogil=True)
def creep_sum(p: Record, relax: Floats, strain: float) -> float:
    """Strain with creep: q [1 + g (c0 + sum_j (s_j / q) / per decade)], 1 at 0.1 s after a step."""
    total = 0.0
    for j in range(relax.size):
        total += relax[j]
    return strain + p.creep_gain_per_decade * (p.creep_static * strain + total / CREEP_PER_DECADE)


@njit(cache=True, nogil=True)
def recall_bridge(parameters: Record, state: Record, ring: Floats) -> float:
    """Return the bridge value [um] sensor_delay_s ago, interpolated linearly."""
    p = parameters[0]
    s = state[0]
    if p.sensor_delay_s == 0.0:
        return s.bridge_um
    wanted = s.time_s - p.sensor_delay_s
    count = int(ring[0, RING])
    later_t, later_y = s.time_s, s.bridge_um
    for back in range(1, min(count, RING) + 1):
        at = (count - back) % RING
        t, y = ring[0, at], ring[1, at]
        if t <= wanted:
            if later_t <= t:
                return y
            return y + (later_y - y) * (wanted - t) / (later_t - t)
        later_t, later_y = t, y
    return later_y


@njit(cache=True, nogil=True)
def uniform(random: NDArray[np.uint64]) -> float:
    """One number in (0, 1): splitmix64 (Steele, Lea and Flood, OOPSLA 2014); random (1,) uint64."""
    random[0] += np.uint64(0x9E3779B97F4A7C15)
    x = random[0]
    x = (x ^ (x >> np.uint64(30))) * np.uint64(0xBF58476D1CE4E5B9)
    x = (x ^ (x >> np.uint64(27))) * np.uint64(0x94D049BB133111EB)
    x = x ^ (x >> np.uint64(31))
    return (float(x >> np.uint64(11)) + 0.5) / 9007199254740992.0


@njit(cache=True, nogil=True)
def reading(parameters: Record, state: Record, ring: Floats, random: NDArray[np.uint64]) -> float:
    """Return the strain-gauge reading now [um]: one fresh sample of noise, then the ADC."""
    p = parameters[0]
    s = state[0]
    y = recall_bridge(parameters, state, ring)
    share = (y - p.origin_um) / p.stroke_um
    shown = p.sensor_gain * (y + 4.0 * p.sensor_bow * p.stroke_um * share * (1.0 - share))
    shown += p.sensor_offset_um
    if p.sensor_noise_um > 0.0:
        if s.has_spare > 0.0:
            s.has_spare = 0.0
            normal = s.spare_normal
        else:  # Box-Muller returns two values
            radius = math.sqrt(-2.0 * math.log(uniform(random)))
            angle = 2.0 * math.pi * uniform(random)
            normal = radius * math.cos(angle)
            s.spare_normal = radius * math.sin(angle)
            s.has_spare = 1.0
        shown += p.sensor_noise_um * normal
    return quantised(shown, p.adc_step_um)
