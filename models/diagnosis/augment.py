"""The augmented model: a joint fit written as hysteresis and blocks of the model file.

The hysteresis is the given model's own where that carries the fit, else the compact monotone one
nearest to the fit (non-negative play weights, for the inverse); a shape and a memory block hold
what the base adds to it; the accepted effects are the other blocks. Simulated, the written model
reproduces the fit.
"""

from dataclasses import replace
from math import comb

import numpy as np
from scipy.optimize import nnls

from dehyst.models.cascade.simulate import channels_of, simulate
from dehyst.models.diagnosis.effects import apply_output_effects
from dehyst.models.diagnosis.fit import Problem
from dehyst.models.diagnosis.joint_fit import JointFit
from dehyst.models.diagnosis.tuning import TUNING
from dehyst.models.identify.data.comparison_drive import make_comparison_drive
from dehyst.models.identify.uncertainty import measure_band_hz
from dehyst.models.model import Block, Fit, Hysteresis, Model, Provenance
from dehyst.models.physics import DriveScale, bent_loops, curved_plays, lead, with_blocks
from dehyst.models.signals.filters import plays
from dehyst.models.signals.joined import Data, Floats
from dehyst.models.signals.pace import measure_slowest_s

REACH_BEYOND = 0.2  # of the drive's range: how far another drive of the same kind may exceed it
REACH_SAMPLES, REACH_S = 300, 0.1  # samples of one sweep over the range, and their interval


def nearest_monotone_hysteresis(problem: Problem, fitted: JointFit) -> Hysteresis:
    """Return the monotone static model nearest to a fit's hysteresis output: play weights >= 0."""
    data, base = problem.data, problem.base
    v = problem.drive_at_hysteresis(fitted.effects)
    r = base.thresholds * base.span
    h = plays(r, v - base.low, data.forgets)
    target = base.combine(v, data.forgets, fitted.weights)
    mean_h, mean_y = h.mean(axis=0), float(target.mean())
    a = h - mean_h
    gram = a.T @ a
    # 1e-9 of the power: the factor exists also where a play never moved
    factor = np.linalg.cholesky(gram + 1e-9 * np.trace(gram) * np.eye(r.size))
    sign = 1.0 if float(a[:, 0] @ (target - mean_y)) >= 0 else -1.0
    b, _ = nnls(factor.T, np.linalg.solve(factor, sign * (a.T @ (target - mean_y))))
    b[0] = max(b[0], 1e-3 * float(b.sum()))  # of the full slope: above 0, for an inverse
    return Hysteresis(r=r, b=sign * b, c=np.array([0.0, 1.0]), u_offset=base.low)


def build_augmented_model(problem: Problem, fitted: JointFit) -> Model:
    """Return the model with the shape and the effects as blocks."""
    data, model = problem.data, problem.diagnosed.model
    if not problem.diagnosed.carries:
        model = replace(model, hysteresis=nearest_monotone_hysteresis(problem, fitted), blocks=())
    added, constant = _added(problem, fitted, model.hysteresis)
    settled = apply_output_effects(data, fitted.effects, np.ones((data.n, 1)))[0, 0]  # static gain
    c = np.array(model.hysteresis.c)
    c[0] += constant + float(fitted.offsets.mean()) / settled
    first = [lead("drive", data.early * data.period)] if data.early else []
    own = [*first, *model.blocks, *added]
    effects = [
        block
        for effect, amplitudes in zip(fitted.effects, fitted.amplitudes, strict=True)
        for block in effect.blocks(amplitudes, data)
    ]
    blocks = with_blocks(replace(model, blocks=tuple(own)), effects).blocks
    rate = np.abs(np.diff(data.u)) / data.dt[1:]
    rate = rate[~data.starts[1:]]
    validity = replace(
        model.validity,
        drive_min=min(model.validity.drive_min, data.u_min),
        drive_max=max(model.validity.drive_max, data.u_min + data.span),
        rate_max=float(rate.max()) if rate.size and rate.max() > 0 else None,
        period_s=data.period,
    )
    return replace(
        model,
        hysteresis=replace(model.hysteresis, c=c),
        validity=validity,
        blocks=blocks,
        fit=Fit(),
        provenance=Provenance(),
    )


def with_rows_early(model: Model, data: Data) -> Model:
    """Return the model for the recordings as they were given, whose readings are some rows early:
    with a lead of these rows."""
    if not data.rows_early:
        return model
    ahead = lead("drive", data.rows_early * data.period)
    return replace(model, blocks=(ahead, *model.blocks))


def state_fit(model: Model, data: Data, fit: Fit) -> Model:
    """Return the model with what it was fitted to: its errors, and how fast and how slow the drive
    was. A model that states its errors keeps them; an error that is not finite counts as not
    known. data: all samples."""
    if model.fit.rms is not None:
        return model
    figures = (fit.rms, fit.holdout_rms, fit.noise_rms)
    fit = Fit(*(x if x is not None and np.isfinite(x) else None for x in figures))
    each = [data.rec == i for i in range(len(data.names))]
    bands = [measure_band_hz(data.u[k], data.period) for k in each]
    slowest = max(measure_slowest_s(data.t[k], data.u[k], data.span) for k in each)
    known = [hz for hz in (*bands, model.validity.band_hz) if hz is not None]
    validity = replace(
        model.validity,
        band_hz=max(known, default=None),
        slowest_s=max(slowest, model.validity.slowest_s or 0.0) or None,
    )
    return replace(model, fit=fit, validity=validity)


def is_within_reach(model: Model, data: Data) -> bool:
    """Return whether the model, driven slowly from rest over the recorded range, stays where the
    stage has been: a shape is known where the recordings went, and powers of it may diverge
    beyond."""
    u = slow_sweeps(data)
    channels = {name: np.full(u.size, data.channels[name].mean()) for name in channels_of(model)}
    y = simulate(model, REACH_S, u, channels)
    room = (TUNING.quarter + REACH_BEYOND) * float(np.ptp(data.y))
    here = bool(np.all(np.isfinite(y)))
    return here and y.min() >= data.y.min() - room and y.max() <= data.y.max() + room


def measure_difference_elsewhere(model: Model, other: Model, data: Data) -> float:
    """Return the rms difference of two models, apart from a constant, on slow loops of several
    sizes throughout the recorded range."""
    u = make_comparison_drive(data.u_min, data.u_min + data.span, 0.0).u

    def play(one: Model) -> Floats:
        channels = {key: np.full(u.size, data.channels[key].mean()) for key in channels_of(one)}
        return simulate(one, REACH_S, u, channels)

    return float(np.std(play(model) - play(other)))


def slow_sweeps(data: Data) -> Floats:
    """Return the (3 REACH_SAMPLES,) drive from rest to the top of the recorded range, to its
    bottom, and back to the top, each extended a little: another drive of the same kind may go
    there."""
    beyond = REACH_BEYOND * data.span
    low, high = data.u_min - beyond, data.u_min + data.span + beyond
    if data.u_min >= 0.0:
        low = max(low, 0.0)
    rest = min(max(0.0, low), high)
    legs = [rest, high, low, high]
    return np.interp(np.linspace(0.0, 3.0, 3 * REACH_SAMPLES), np.arange(4.0), legs)


def _added(problem: Problem, fitted: JointFit, hysteresis: Hysteresis) -> tuple[list[Block], float]:
    """Return the blocks for what the base adds to the hysteresis, and the remaining constant."""
    if problem.base.width == 0:
        return [], 0.0
    shape, constant = _shape(problem, fitted, hysteresis)
    return [shape, _memory(problem, fitted)], constant


def _shape(problem: Problem, fitted: JointFit, hysteresis: Hysteresis) -> tuple[Block, float]:
    """Return the base's curved plays, in plays from 0 upwards, less the hysteresis made of them, as
    a block, and the remaining constant.

    The base's columns are powers of h = H - 1 with H the play of the drive scaled to 0..2; powers
    of H follow from the binomial theorem.
    """
    base = problem.base
    w = base.full(fitted.weights)
    n = base.thresholds.size
    half = 0.5 * base.span
    powers = w[: 5 * n].reshape(5, n)  # of h, from the first
    e = np.zeros((6, n))
    for power in range(1, 6):
        for k in range(power + 1):
            e[k] += comb(power, k) * (-1.0) ** (power - k) * powers[power - 1]
    if not problem.diagnosed.carries:
        e[1] -= hysteresis.b * half
    scale = DriveScale(base.low, half, problem.data.drive_unit)
    return curved_plays(base.thresholds * base.span, e[1:], scale), float(np.sum(e[0]))


def _memory(problem: Problem, fitted: JointFit) -> Block:
    """Return the block of the Dahl columns and the high powers of the rich base, in the base's
    order."""
    base = problem.base
    m = base.lengths.size
    w = base.full(fitted.weights)[5 * base.thresholds.size :]
    z, zx, zz, zxx, zzz = w[: 5 * m].reshape(5, m)
    half = 0.5 * base.span
    scale = DriveScale(base.low + half, half, problem.data.drive_unit)
    weights = np.stack([z, zx, zxx, zz, zzz])
    return bent_loops(base.lengths * base.span, weights, w[5 * m : 5 * m + 2], scale)
