"""Invert a whole trajectory, and run the daemon's inverse without the daemon.

A whole trajectory is solved as one window. The candidates are the static inverse, the preview's
sweeps to convergence, and refinements of the sweeps and of the preview's drive with the exact
Jacobian (dehyst.models.inverse.refine). The preview's own drive is one more candidate. The one with
the least predicted error is kept, so the result is never worse than the preview.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from dehyst.models.cascade.step import invert_stage_blocks
from dehyst.models.inverse import sample
from dehyst.models.inverse.choice import MODES
from dehyst.models.inverse.compensator import Compensator, CompensatorState
from dehyst.models.inverse.refine import improve_by_sweeps, limit_drive, refine
from dehyst.models.inverse.tuning import TUNING
from dehyst.models.model import Floats
from dehyst.models.signals.error_size import rms

UNREACHABLE = sample.BEYOND_DRIVE | sample.BEYOND_SATURATION


@dataclass(frozen=True)
class Inverted:
    """drive, predicted displacement, predicted reading: (N,); flags: (N,) int64 bits as in
    dehyst.models.inverse.compensator; mode: how the drive was computed; rms: of the predicted
    error after the approach, over samples whose target can be reached; NaN: there are none."""

    drive: Floats
    predicted: Floats
    reading: Floats
    flags: NDArray[np.int64]
    mode: str
    rms: float


def _targets(
    comp: Compensator, start: CompensatorState, target: Floats, channels: Floats
) -> Floats:
    """Return the displacements of the hysteresis: delays shifted out, stage blocks undone."""
    late = comp.delay_s / comp.period_s
    at = np.arange(target.size)
    seq = np.interp(at + late, at, target) if late else target.copy()
    if comp.has_stage_blocks:
        led = np.concatenate([[seq[0]], seq])
        blocks = start.inverse.blocks
        invert_stage_blocks(
            comp.chain, blocks, blocks.copy(), channels, 1, comp.period_s, comp.period_s, led
        )
        seq = led[1:]
    return np.ascontiguousarray(seq)


def _replayed(
    comp: Compensator, start: float, drive: Floats, channels: Floats
) -> tuple[Floats, Floats]:
    """Return the displacement and reading (N,) that the model predicts for a drive."""
    state = comp.init(start)
    y, reading = np.empty(drive.size), np.empty(drive.size)
    for i, u in enumerate(drive.tolist()):
        if state.channels.size:
            state.channels[:] = channels[i]
        comp.applied(state, u)
        y[i], reading[i] = state.predicted, state.reading
    return y, reading


def invert_streamed(
    comp: Compensator, target: Floats, channels: Floats | None = None, start: float | None = None
) -> Inverted:
    """Compute exactly what the daemon would do with this compensator: each sample sees
    `comp.window_samples` targets from its own on; the last target holds after the end. Arguments as
    for `invert_trajectory`."""
    target = np.ascontiguousarray(target, np.float64)
    n, width = target.size, comp.window_samples
    held = np.append(target, np.full(width, target[-1]))
    channels = np.zeros((n, len(comp.channels))) if channels is None else channels
    at = min(max(0.0, comp.low), comp.high) if start is None else start
    state = comp.init(at)
    drive, y, reading = np.empty(n), np.empty(n), np.empty(n)
    flags, modes = np.zeros(n, np.int64), np.zeros(4, np.int64)
    for i in range(n):
        comp.step(state, held[i : i + width], width, channels[i])
        drive[i] = state.drive
        flags[i] = state.flags
        modes[state.mode] += 1
        comp.applied(state, drive[i])
        y[i], reading[i] = state.predicted, state.reading
    mode = MODES[int(np.argmax(modes))]
    error = y - target
    return Inverted(drive, y, reading, flags, mode, rms(error[_settled(error, flags, comp)]))


def invert_trajectory(
    comp: Compensator, target: Floats, channels: Floats | None = None, start: float | None = None
) -> Inverted:
    """Return the drive (N,) for a whole trajectory (N,), sampled at the compensator's period.

    By the model's prediction it is not worse than `invert_streamed` with the same compensator,
    neither after the approach (the error that ranks the candidates) nor including it.

    channels: (N, number of comp.channels) values of the model's further channels; start: drive
    before the first sample, None: 0 or the end of the range next to it.
    """
    streamed = invert_streamed(comp, target, channels, start)
    if not comp.planned or target.size < 8:  # samples: too few to plan
        return streamed
    target = np.ascontiguousarray(target, np.float64)
    n = target.size
    channels = np.zeros((n, len(comp.channels))) if channels is None else channels
    at = min(max(0.0, comp.low), comp.high) if start is None else start
    state = comp.init(at)
    first = channels[0] if n else np.zeros(0)
    goal = _targets(comp, state, target, first)
    static, _ = comp.static.run(goal, state.inverse.plays, at)
    static = limit_drive(comp, static, at)
    sweeps = improve_by_sweeps(comp, static.copy(), state, goal)
    drives = {"static": static, "sweeps": sweeps}
    reachable = (streamed.flags & UNREACHABLE) == 0
    settled = _settled(streamed.predicted - target, streamed.flags, comp)
    if n <= TUNING.refined_samples:
        drives["exact"] = refine(comp, sweeps, state, goal, 0)
        approach = int(np.argmax(settled))
        drives["exact from preview"] = refine(comp, streamed.drive.copy(), state, goal, approach)
    best, most = streamed, rms((streamed.predicted - target)[reachable])
    for name, inside in drives.items():
        drive = comp.command(inside, at)
        y, reading = _replayed(comp, at, drive, channels)
        error = y - target
        left = rms(error[settled])
        if left < best.rms and rms(error[reachable]) <= most:
            fast = np.abs(np.diff(drive, prepend=at)) >= comp.rate * comp.period_s * (1 - 1e-9)
            flags = np.where(reachable, 0, streamed.flags & UNREACHABLE)
            flags |= np.where(fast, sample.SLEW, 0)
            flags |= np.where(comp.outside(drive, at), sample.OUTSIDE, 0)
            best = Inverted(drive, y, reading, flags, name, left)
    return best


def _settled(error: Floats, flags: NDArray[np.int64], comp: Compensator) -> NDArray[np.bool_]:
    """Return (N,) where the target can be reached, without the approach from the start."""
    inside = (flags & UNREACHABLE) == 0
    arrived = inside & (np.abs(error) <= TUNING.arrived * comp.noise)
    over = int(np.argmax(arrived)) + round(TUNING.settles_s / comp.period_s)
    if np.any(arrived) and np.any(inside[over:]):
        inside[:over] = False
    return inside
