"""The simulated stage as compiled kernels with explicit state: no clock, no files, no objects.

`advance_stage` advances one axis in time, `advance_platform` several coupled axes, and `run_stage`
processes whole arrays for one axis. The parts are in parts.py.

Linear parts are discretised exactly (input held or linear over a sub-step), so they are stable at
any step length. Sub-steps resolve the RC corner and the mode only while something moves; a stage at
rest takes one sub-step however long it rests.
"""

import math
from typing import NamedTuple

import numpy as np
from numba import njit
from numpy.typing import NDArray

from dehyst.drivers.simulated.maxwell_slip import slip_sum, static_map
from dehyst.drivers.simulated.parts import (
    CREEP_TAUS_S,
    RING,
    Floats,
    Record,
    creep_sum,
    cross,
    displacement,
    electrical,
    mode_factors,
    quantised,
    reading,
)
from dehyst.drivers.simulated.tuning import TUNING

SETTLED, STILL, RATE_TAU_S = TUNING.settled, TUNING.still, TUNING.rate_tau_s
TOGETHER_S = TUNING.together_s


class StageArrays(NamedTuple):
    """A simulated stage as arrays.

    parameters, state: (1,) records of PARAMETERS_T and STATE_T; elements: (3, n) slip strain,
    stiffness, bow; springs: (n,) their stretches; relax: (m,) creep relaxations; ring: (2, RING +
    1) times [s] and bridge values [um] of the delay line, where ring[0, RING] counts the entries
    and state.pushed_s is the last time; random: (1,) state of the noise.
    """

    parameters: Record
    elements: Floats
    state: Record
    springs: Floats
    relax: Floats
    ring: Floats
    random: NDArray[np.uint64]


@njit(cache=True, nogil=True)
def advance_stage(plant: StageArrays, dt: float, v0: float, v1: float) -> None:
    """Advance by dt seconds while the command goes from v0 to v1 [V] (v0 == v1: held)."""
    elements, springs, relax, ring = plant.elements, plant.springs, plant.relax, plant.ring
    p = plant.parameters[0]
    s = plant.state[0]
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
        wanted = quantised(held, p.dac_step_v) + p.ext_gain * s.ext_v
        wanted = min(p.clip_max_v, max(p.clip_min_v, wanted))
        tiny = SETTLED * p.full_scale_v
        rest = v0 == v1 and abs(wanted - s.amplifier_v) < tiny
        rest = rest and abs(wanted - s.source_v) < tiny and abs(wanted - s.drive_v) < tiny
        if p.mode_hz > 0.0:  # resolve the ringing too: it reaches the bridge's filter
            swing = abs(s.mode_rate) / (2.0 * math.pi * p.mode_hz)
            rest = rest and abs(s.mode - s.creep) < STILL and swing < STILL
        rest = rest and abs(s.cross_um - s.others_um) < STILL * p.stroke_um
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
                a11, a12, a21, a22 = mode_factors(p.mode_hz, p.mode_damping, h)
        done += h
        s.time_s = begin_s + done

        # electrical part, then hysteresis, which remembers extremes: one evaluation per sub-step is
        # enough
        x0 = s.drive_v / p.full_scale_v
        if not rest:
            electrical(p, s, held, h, rc_decay, amplifier_decay)
        x1 = s.drive_v / p.full_scale_v
        stiffer = 1.0
        if p.rate_per_decade > 0.0:
            rate = abs(x1 - x0) / h
            s.rate = rate + (s.rate - rate) * rate_decay
            stiffer = 1.0 + p.rate_per_decade * math.log10(1.0 + s.rate)
        before = s.strain
        if x1 != x0 or p.rate_per_decade > 0.0:
            s.slip = stiffer * slip_sum(elements[0], elements[1], elements[2], springs, x0, x1)
            s.strain = static_map(p.asymmetry, (x1 - s.slip) / p.norm)
        if p.rc_tau_s == 0.0 and p.slew_v_per_s == 0.0 and v0 == v1:
            before = s.strain  # nothing upstream smooths a step: it happens at once

        # creep; the mode's input goes linearly from c0 to c1
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

        # the other parts, and the bridge's filter with linear input
        y0 = s.true_um
        cross(p, s, h)
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


class PlatformArrays(NamedTuple):
    """The axes of one simulated stage, in the order of settings.AXES: the arrays of StageArrays,
    stacked; present: (3,) 1 for an axis that exists."""

    parameters: Record
    elements: Floats
    state: Record
    springs: Floats
    relax: Floats
    ring: Floats
    random: NDArray[np.uint64]
    present: NDArray[np.int64]


@njit(cache=True, nogil=True)
def axis_of(platform: PlatformArrays, i: int) -> StageArrays:
    """Return one axis as views."""
    return StageArrays(
        platform.parameters[i : i + 1],
        platform.elements[3 * i : 3 * i + 3],
        platform.state[i : i + 1],
        platform.springs[i],
        platform.relax[i],
        platform.ring[2 * i : 2 * i + 2],
        platform.random[i : i + 1],
    )


@njit(cache=True, nogil=True)
def advance_platform(platform: PlatformArrays, dt: float) -> None:
    """Advance all axes by dt seconds under their commands, in parallel.

    What an axis contributes to the others is held over a step of TUNING.together_s; while nothing
    moves the steps grow.
    """
    state, parameters = platform.state, platform.parameters
    alone = platform.present.sum() == 1
    done, h = 0.0, TOGETHER_S
    while dt - done > 1e-12 * max(1.0, dt):
        h = dt - done if alone else min(h, dt - done)
        for i in range(state.size):
            p, s = parameters[i], state[i]
            s.others_um = p.from_x * state[0].moved_um
            s.others_um += p.from_y * state[1].moved_um + p.from_z * state[2].moved_um
        moved = 0.0
        for i in range(state.size):
            if platform.present[i]:
                s = state[i]
                before = s.moved_um
                advance_stage(axis_of(platform, i), h, s.command_v, s.command_v)
                moved = max(moved, abs(s.moved_um - before) / parameters[i].stroke_um)
        done += h
        h = 2.0 * h if moved < STILL else TOGETHER_S


@njit(cache=True, nogil=True)
def run_stage(
    plant: StageArrays, t_s: Floats, volts: Floats, extra: Floats, straight: bool
) -> tuple[Floats, Floats]:
    """Return true displacement and reading (N,) each at t_s (N,); volts[k] acts from t_s[k] on.

    extra: (3, N) EXT volts, other axis' volts, temperature [K]. straight: the command is
    interpolated linearly between samples instead of being held.
    """
    s = plant.state[0]
    true_um = np.empty(t_s.size)
    shown_um = np.empty(t_s.size)
    for n in range(t_s.size):
        if n > 0:
            first = volts[n - 1]
            last = volts[n] if straight else first
            step = t_s[n] - t_s[n - 1]
            advance_stage(plant, step, first, last)
        s.ext_v = extra[0, n]
        s.other_v = extra[1, n]
        s.temperature_k = extra[2, n]
        true_um[n] = s.true_um
        shown_um[n] = reading(plant.parameters, plant.state, plant.ring, plant.random)
    s.command_v = volts[-1]
    return true_um, shown_um
