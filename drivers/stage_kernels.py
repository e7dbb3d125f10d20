"""The simulated stage as compiled kernels with explicit state: no clock, no files, no objects.

    command -> DAC step -> + gain x EXT -> clip -> amplifier lag -> 60 mA slew -> RC
            -> hysteresis -> creep -> mechanical mode -> guide friction
            -> temperature, drift, coupling, hum -> bridge filter -> delay -> noise -> ADC

Linear parts are discretised exactly (a held or a straight-line input over a sub-step), so they
are stable at any step length. Sub-steps resolve the RC corner and the mode only while the
capacitor still moves; a stage at rest takes one sub-step however long it rests.
"""

import math
from typing import Any

import numpy as np
from numba import njit
from numpy.typing import NDArray

from dehyst.drivers.maxwell_slip import slip_sum, static_map

Floats = NDArray[np.float64]
Record = Any  # numba reads a (1,) structured array; its scalar has attributes

PARAMETERS = (
    "full_scale_v stroke_um origin_um dac_step_v ext_gain clip_min_v clip_max_v amplifier_tau_s "
    "slew_v_per_s rc_tau_s asymmetry rate_per_decade creep_gain_per_decade creep_static "
    "mode_hz mode_damping mode_share friction_um gain_per_k expansion_um_per_k drift_um_per_s "
    "coupling_um_per_v hum_um hum_hz sensor_tau_s sensor_delay_s sensor_gain sensor_offset_um "
    "sensor_bow sensor_noise_um adc_step_um norm substep_s quiet_s"
).split()
STATE = (
    "time_s command_v ext_v other_v temperature_k clipped "  # inputs as they stand
    "amplifier_v source_v drive_v rate "  # electrical; rate: filtered |drive rate|, range per s
    "slip strain creep mode mode_rate friction "  # mechanical, normalised to the stroke
    "shift_um true_um bridge_um pushed_s spare_normal has_spare"
).split()
PARAMETERS_T = np.dtype([(name, np.float64) for name in PARAMETERS])
STATE_T = np.dtype([(name, np.float64) for name in STATE])

# Relaxations of the creep operator: log-spaced time constants, the first well below 0.1 s.
CREEP_PER_DECADE = 3
CREEP_TAUS_S = 10.0 ** np.arange(-2.0, 4.51, 1.0 / CREEP_PER_DECADE)
RATE_TAU_S = 0.005  # the walls' inertia: how fast rate dependence follows the rate
RING = 8192  # samples of the delay line
SETTLED = 1e-10  # share of full scale at which the capacitor counts as charged
STILL = 1e-6  # share of the stroke below which the mode counts as still


@njit(cache=True, nogil=True)
def rounded(value: float, step: float) -> float:
    """The nearest multiple of step; step 0: the value itself."""
    return value if step == 0.0 else step * np.round(value / step)


@njit(cache=True, nogil=True)
def electrical(
    p: Record, s: Record, command_v: float, h: float, rc_decay: float, amplifier_decay: float
) -> None:
    """DAC, EXT, clip, amplifier lag, slew, RC over h seconds: updates s, returns nothing."""
    wanted = rounded(command_v, p.dac_step_v) + p.ext_gain * s.ext_v
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
    if ramp_s > 0.0:  # the capacitor follows a ramp tau late, then relaxes towards the end of it
        late = move / ramp_s * tau
        s.drive_v = s.source_v - late + (s.drive_v - start + late) * math.exp(-ramp_s / tau)
        rc_decay = math.exp(-(h - ramp_s) / tau)
    s.drive_v = s.source_v + (s.drive_v - s.source_v) * rc_decay


@njit(cache=True, nogil=True)
def mode_factors(p: Record, h: float) -> tuple[float, float, float, float]:
    """Transition of the mode's free motion over h seconds: a11, a12, a21, a22."""
    w = 2.0 * math.pi * p.mode_hz
    wd = w * math.sqrt(1.0 - p.mode_damping**2)
    fade = math.exp(-p.mode_damping * w * h)
    c, sn = math.cos(wd * h), math.sin(wd * h)
    ratio = p.mode_damping * w / wd
    return (
        fade * (c + ratio * sn),
        fade * sn / wd,
        -fade * sn * w * w / wd,
        fade * (c - ratio * sn),
    )


@njit(cache=True, nogil=True)
def displacement(p: Record, s: Record) -> float:
    """True displacement [um] from the state as it stands; moves the guide's friction with it."""
    share = p.mode_share if p.mode_hz > 0.0 else 0.0
    moved = p.stroke_um * ((1.0 - share) * s.creep + share * s.mode)
    s.friction = max(moved - p.friction_um, min(moved + p.friction_um, s.friction))
    warm = s.temperature_k
    y = p.origin_um + s.friction * (1.0 + p.gain_per_k * warm) + p.expansion_um_per_k * warm
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
def advance(
    parameters: Record,
    elements: Floats,
    state: Record,
    z: Floats,
    relax: Floats,
    ring: Floats,
    dt: float,
    v0: float,
    v1: float,
) -> None:
    """Advance by dt seconds while the command goes from v0 to v1 [V] (v0 == v1: held).

    parameters, state: (1,) records of PARAMETERS_T and STATE_T; elements: (3, n) slip strain,
    stiffness, bow; z: (n,) spring stretches; relax: (m,) creep relaxations; ring: (2, RING)
    times [s] and bridge values [um] of the delay line, with state.pushed_s the last time.
    """
    p = parameters[0]
    s = state[0]
    begin_s = s.time_s
    s.command_v = v1
    decay = np.empty(relax.size)
    known_h = -1.0
    done = 0.0
    rc_decay = amplifier_decay = sensor_decay = rate_decay = 0.0
    a11 = a12 = a21 = a22 = 0.0
    steps = max(1.0, math.ceil(dt / p.substep_s - 1e-9))
    small_h = dt / steps
    while dt - done > 1e-12 * max(1.0, dt):
        h = min(small_h, dt - done)
        held = v0 + (v1 - v0) * (done + 0.5 * h) / dt
        wanted = rounded(held, p.dac_step_v) + p.ext_gain * s.ext_v
        wanted = min(p.clip_max_v, max(p.clip_min_v, wanted))
        tiny = SETTLED * p.full_scale_v
        rest = v0 == v1 and abs(wanted - s.amplifier_v) < tiny
        rest = rest and abs(wanted - s.source_v) < tiny and abs(wanted - s.drive_v) < tiny
        if p.mode_hz > 0.0:  # what rings is resolved too: the bridge's filter sees it
            swing = abs(s.mode_rate) / (2.0 * math.pi * p.mode_hz)
            rest = rest and abs(s.mode - s.creep) < STILL and swing < STILL
        if rest:
            s.amplifier_v = s.source_v = s.drive_v = wanted
            h = min(p.quiet_s, dt - done)
        if abs(h - known_h) > 1e-9 * h:
            known_h = h
            for j in range(relax.size):
                decay[j] = -math.expm1(-h / CREEP_TAUS_S[j])
            rc_decay = math.exp(-h / p.rc_tau_s) if p.rc_tau_s > 0.0 else 0.0
            amplifier_decay = math.exp(-h / p.amplifier_tau_s) if p.amplifier_tau_s > 0.0 else 0.0
            sensor_decay = math.exp(-h / p.sensor_tau_s) if p.sensor_tau_s > 0.0 else 0.0
            rate_decay = math.exp(-h / RATE_TAU_S)
            if p.mode_hz > 0.0:
                a11, a12, a21, a22 = mode_factors(p, h)
        done += h
        s.time_s = begin_s + done

        # electrical, then hysteresis: memory of the extremes, so one evaluation a sub-step
        x0 = s.drive_v / p.full_scale_v
        if not rest:
            electrical(p, s, held, h, rc_decay, amplifier_decay)
        x1 = s.drive_v / p.full_scale_v
        dilate = 1.0
        if p.rate_per_decade > 0.0:
            rate = abs(x1 - x0) / h
            s.rate = rate + (s.rate - rate) * rate_decay
            dilate = 1.0 + p.rate_per_decade * math.log10(1.0 + s.rate)
        before = s.strain
        if x1 != x0 or p.rate_per_decade > 0.0:
            s.slip = slip_sum(elements[0], elements[1], elements[2], z, x0, x1, dilate)
            s.strain = static_map(p.asymmetry, (x1 - s.slip) / p.norm)
        if p.rc_tau_s == 0.0 and p.slew_v_per_s == 0.0 and v0 == v1:
            before = s.strain  # nothing in front rounds a step: it happens at once

        # creep; the mode sees its input go straight from c0 to c1
        middle = 0.5 * (before + s.strain)
        c0 = creep_sum(p, relax, before)
        for j in range(relax.size):
            relax[j] += (middle - relax[j]) * decay[j]
        s.creep = creep_sum(p, relax, s.strain)
        if p.mode_hz > 0.0:
            slope = (s.creep - c0) / h
            late = 2.0 * p.mode_damping * slope / (2.0 * math.pi * p.mode_hz)
            e, de = s.mode - c0 + late, s.mode_rate - slope
            s.mode = s.creep - late + a11 * e + a12 * de
            s.mode_rate = slope + a21 * e + a22 * de
        else:
            s.mode = s.creep
            s.mode_rate = 0.0

        # the rest, and the bridge's filter with a straight-line input
        y0 = s.true_um
        s.true_um = displacement(p, s)
        if p.sensor_tau_s > 0.0:
            late = (s.true_um - y0) / h * p.sensor_tau_s
            s.bridge_um = s.true_um - late + (s.bridge_um - y0 + late) * sensor_decay
        else:
            s.bridge_um = s.true_um
        if p.sensor_delay_s > 0.0 and s.time_s - s.pushed_s >= p.sensor_delay_s / (RING // 4):
            s.pushed_s = s.time_s
            head = int(ring[0, RING]) % RING
            ring[0, head] = s.time_s
            ring[1, head] = s.bridge_um
            ring[0, RING] += 1.0


@njit(cache=True, nogil=True)
def delayed(parameters: Record, state: Record, ring: Floats) -> float:
    """Bridge value [um] sensor_delay_s ago, straight line between the stored ones."""
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
    """What the strain-gauge reader shows now [um]: one fresh sample of noise, then the ADC."""
    p = parameters[0]
    s = state[0]
    y = delayed(parameters, state, ring)
    share = (y - p.origin_um) / p.stroke_um
    shown = p.sensor_gain * (y + 4.0 * p.sensor_bow * p.stroke_um * share * (1.0 - share))
    shown += p.sensor_offset_um
    if p.sensor_noise_um > 0.0:
        if s.has_spare > 0.0:
            s.has_spare = 0.0
            normal = s.spare_normal
        else:  # Box-Muller gives two
            radius = math.sqrt(-2.0 * math.log(uniform(random)))
            angle = 2.0 * math.pi * uniform(random)
            normal = radius * math.cos(angle)
            s.spare_normal = radius * math.sin(angle)
            s.has_spare = 1.0
        shown += p.sensor_noise_um * normal
    return rounded(shown, p.adc_step_um)


@njit(cache=True, nogil=True)
def run(
    parameters: Record,
    elements: Floats,
    state: Record,
    z: Floats,
    relax: Floats,
    ring: Floats,
    random: NDArray[np.uint64],
    t_s: Floats,
    volts: Floats,
    extra: Floats,
    straight: bool,
) -> tuple[Floats, Floats]:
    """True displacement and reading (N,) each at t_s (N,); volts[k] acts from t_s[k] on.

    extra: (3, N) EXT volts, other axis' volts, temperature [K]. straight: the command goes in a
    straight line between samples instead of being held.
    """
    s = state[0]
    true_um = np.empty(t_s.size)
    shown_um = np.empty(t_s.size)
    for n in range(t_s.size):
        if n > 0:
            first = volts[n - 1]
            last = volts[n] if straight else first
            step = t_s[n] - t_s[n - 1]
            advance(parameters, elements, state, z, relax, ring, step, first, last)
        s.ext_v = extra[0, n]
        s.other_v = extra[1, n]
        s.temperature_k = extra[2, n]
        true_um[n] = s.true_um
        shown_um[n] = reading(parameters, state, ring, random)
    s.command_v = volts[-1]
    return true_um, shown_um
