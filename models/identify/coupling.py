"""Identify the coupling from other axes: y = f(u) + sum_k gain_k (channel_k - reference_k).

Recordings of one axis that also contain the other axes (channels `axis.y`, their displacement, or
`axis.y.drive`) are fitted with one gain for each, if it pays on held-out stretches. The gains are
fitted to the residual of the model without them, after projecting out of both what the own drive
could also explain (R. Frisch and F. V. Waugh, Econometrica 1, 1933), so axes that moved together do
no harm. Memory, modes and lags of a coupling are left to a diagnosis.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from dehyst.models.identify.tuning import TUNING
from dehyst.models.model import Model
from dehyst.models.physics import coupled, with_blocks
from dehyst.models.recording import AXIS_CHANNEL, Bools, Floats, Recording
from dehyst.models.signals.filters import plays


@dataclass(frozen=True)
class Coupled:
    """One gain. channel: of the recordings; gain: displacement per unit of the channel; reference:
    mean of the channel; before, after: held-out rms without and with the gain, over stretches in
    which the channel moves."""

    channel: str
    gain: float
    reference: float
    before: float
    after: float


def find_other_axes(recordings: Sequence[Recording]) -> list[str]:
    """Return the channels that every recording has and that move: the displacement of another axis,
    or its drive if there is no displacement."""
    names = [n for n in recordings[0].channels if AXIS_CHANNEL.fullmatch(n)]
    names = [n for n in names if all(n in r.channels for r in recordings)]
    moving = [n for n in names if any(np.nan_to_num(np.nanstd(r.channels[n])) for r in recordings)]
    return [n for n in moving if not (n.endswith(".drive") and n[: -len(".drive")] in moving)]


def couple(
    recordings: Sequence[Recording], residuals: Sequence[Floats], known: Sequence[Coupled] = ()
) -> list[Coupled]:
    """Return the gains that pay, the largest improvement first. residuals: one (N,) for each
    recording, its displacement or the residual of a model, NaN where it does not count; known:
    couplings that the model already contains: they are kept, and their gains are corrected."""
    names = find_other_axes(recordings)
    if not names:
        return []
    rest = _Rest(recordings, residuals, names)
    taken = [names.index(one.channel) for one in known]
    found = {one.channel: one for one in known}
    gains = np.zeros(len(names))
    gains[taken] = [one.gain for one in known]
    open_ = [i for i in range(len(names)) if i not in taken]
    while open_ and not known:
        trials = [(*rest.try_out(taken, i), i) for i in open_]
        trials = [trial for trial in trials if trial[2]]
        if not trials:
            break
        before, after, _, best = min(trials, key=lambda trial: trial[1] - trial[0])
        taken.append(best)
        open_.remove(best)
        found[names[best]] = Coupled(names[best], 0.0, rest.means[best], before, after)
    if taken:
        gains[taken] += rest.gains(taken, np.ones(rest.left.size, dtype=bool))
    return [replace(found[names[i]], gain=float(gains[i])) for i in taken]


def uncouple(recording: Recording, couplings: Sequence[Coupled]) -> Recording:
    """Return the recording as if the other axes had stayed at their means."""
    assert recording.displacement is not None
    y = recording.displacement.copy()
    for one in couplings:
        y -= one.gain * (recording.channels[one.channel] - one.reference)
    return replace(recording, displacement=y)


def without_rests(recording: Recording) -> Recording:
    """Return the recording without the displacement at long rests of its own drive, where only the
    other axes can move the stage."""
    assert recording.displacement is not None
    u = recording.drive
    rounding = 1e-6 * float(np.nanmax(u) - np.nanmin(u))  # a drive that changes less is at rest
    still = np.abs(np.diff(u, prepend=u[:1])) <= rounding
    last_move = np.maximum.accumulate(np.where(still, 0, np.arange(u.size)))
    rests = recording.t_s - recording.t_s[last_move] > TUNING.slow_s
    return replace(recording, displacement=np.where(rests, np.nan, recording.displacement))


def with_couplings(model: Model, couplings: Sequence[Coupled]) -> Model:
    """Return the model with a block for each coupling, before those of the sensor."""
    unit = model.displacement_unit
    blocks = (coupled(unit, one.gain, one.reference, one.channel) for one in couplings)
    return with_blocks(model, blocks)


class _Rest:
    """The residual of a model and the channels, both without the part that the own drive
    explains."""

    def __init__(
        self, recordings: Sequence[Recording], residuals: Sequence[Floats], names: Sequence[str]
    ) -> None:
        span = max(float(np.nanmax(r.drive) - np.nanmin(r.drive)) for r in recordings)
        lefts, columns, pieces, count = [], [], [], 0
        for recording, residual in zip(recordings, residuals, strict=True):
            channels = np.stack([recording.channels[n] for n in names], axis=1)
            good = ~np.isnan(residual) & ~np.isnan(channels).any(axis=1) & ~recording.missing_drive
            if not good.any():
                continue
            u = recording.drive[good]
            begin = np.zeros(u.size, dtype=bool)
            begin[0] = True
            r = np.linspace(0.0, 0.5, TUNING.few_operators) * span
            piece = np.arange(u.size) * TUNING.parts // u.size
            # a level for each stretch: creep and drift are not coupling
            levels = piece[:, None] == np.arange(TUNING.parts)
            h = plays(r, np.ascontiguousarray(u), begin) / span
            z = (u - u.mean()) / span
            own = np.column_stack([levels, h, z**2, z**3])
            pair = np.column_stack([residual[good], channels[good]])
            pair = pair - own @ np.linalg.lstsq(own, pair, rcond=None)[0]
            lefts.append(pair[:, 0])
            columns.append(pair[:, 1:])
            pieces.append(count + piece)
            count += TUNING.parts
        self.left = np.concatenate(lefts)
        self.columns = np.concatenate(columns)
        self.piece = np.concatenate(pieces)
        self.count = count
        whole = [np.concatenate([r.channels[n] for r in recordings]) for n in names]
        self.means = [float(np.nanmean(one)) for one in whole]

    def gains(self, taken: Sequence[int], rows: Bools) -> Floats:
        """Return the gains (len(taken),) fitted to these rows."""
        c = self.columns[rows][:, list(taken)]
        return np.asarray(np.linalg.lstsq(c, self.left[rows], rcond=None)[0], np.float64)

    def try_out(self, taken: Sequence[int], more: int) -> tuple[float, float, bool]:
        """Return the held-out rms without and with one more channel, over the stretches in which it
        moves, and whether adding it pays."""
        moves = np.bincount(self.piece, self.columns[:, more] ** 2, self.count)
        size = np.bincount(self.piece, minlength=self.count)
        lively = np.flatnonzero(moves > TUNING.minor * moves.sum() / self.count)
        powers = np.zeros((2, lively.size))
        for k, piece in enumerate(lively):
            held = self.piece == piece
            for row, some in enumerate((list(taken), [*taken, more])):
                error = self.left[held]
                if some:
                    error = error - self.columns[held][:, some] @ self.gains(some, ~held)
                powers[row, k] = float(error @ error)
        before, after = np.sqrt(powers.sum(axis=1) / max(1, int(size[lively].sum())))
        gain = powers[0] - powers[1]
        if lively.size < 2 or gain.sum() < TUNING.small * powers[0].sum():
            return float(before), float(after), False
        doubt = float(np.std(gain, ddof=1)) / np.sqrt(gain.size)
        return float(before), float(after), bool(gain.mean() > TUNING.sure * doubt)
