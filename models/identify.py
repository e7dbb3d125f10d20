"""Identification: recordings in, an invertible model out, with what it is worth.

Structure first (dehyst.models.selection, by hold-out on at most some thousand rows), then one fit
of that structure to all rows (dehyst.models.solver). The parameters of Eq. 6 of Qin et al. are all
found from one recording; the weights are monotone over the identified rate range by their bounds.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field

import numpy as np

from dehyst.models.equations import Params, Shape, blocks_of
from dehyst.models.errors import BadInput, BadRecording, NotInvertible
from dehyst.models.glitches import thinned
from dehyst.models.model import Fit, Model, Provenance, Validity
from dehyst.models.noise import drive_band_hz, parameter_covariance, rough_rms
from dehyst.models.problem import Problem, set_up
from dehyst.models.reach import invertible
from dehyst.models.recording import Bools, Floats, Recording
from dehyst.models.rows import Rows, prepare
from dehyst.models.selection import (
    LEAST_SATURATION,
    Candidate,
    Choice,
    choose_thresholds,
    first_grid,
    fit_finest,
    make_pull,
    pick_shape,
    prior_for,
    pull_blocks,
    shapes,
    split,
    try_shapes,
)
from dehyst.models.solver import lower_bounds, solve

LEAST_EXPLAINED = 0.5  # of the displacement's power, held out: below this it does not follow
ROWS_FINEST = 100_000  # at most so many for the fit without bounds
ROWS_FITTED = 1_000_000  # and so many for the last fit: more do not lower its error by a nanometre
MOST_HELD = 30_000_000  # numbers in the equations of the last fit
START_FACTOR = 2.0  # rms at the start, against the rest, that the assumed start state may leave
START_SHARE = 0.01  # of the displacement's range that it may leave anyway


@dataclass(frozen=True)
class Options:
    """What the user fixed; None: chosen by hold-out.

    order: play operators (1 to 200); rate: rate-dependent or static; saturation: degree of the
    polynomial (1 to 9); bias: even powers allowed (True: demanded); monotone: False gives the
    plain least-squares fit, which in general cannot be inverted (for comparison only).
    """

    order: int | None = None
    rate: bool | None = None
    saturation: int | None = None
    bias: bool | None = None
    monotone: bool = True

    def __post_init__(self) -> None:
        if self.order is not None and not 1 <= self.order <= 200:
            raise BadInput(f"order: 1 to 200 play operators, not {self.order}")
        if self.saturation is not None and not 1 <= self.saturation <= 9:
            raise BadInput(f"saturation: a degree from 1 to 9, not {self.saturation}")


@dataclass(frozen=True)
class Identification:
    """The model and what it is worth.

    residuals: one (N,) array per recording, y - model, NaN where there is none; used: (N,) rows
    that were fitted; shape, offset: the structure; params, errors: packed parameters and their
    standard errors (0: on the bound); tried, orders: what the hold-out compared; notes: what a
    reader should be told.
    """

    model: Model
    residuals: tuple[Floats, ...]
    used: tuple[Bools, ...]
    shape: Shape
    params: Params
    errors: Params
    at_bound: Bools
    tried: tuple[Candidate, ...]
    orders: tuple[tuple[int, float], ...]
    noise_rms: float
    notes: tuple[str, ...] = field(default_factory=tuple)


def _quiet(text: str) -> None:
    """No progress wanted."""


def identify(
    recordings: Sequence[Recording],
    options: Options | None = None,
    progress: Callable[[str], None] = _quiet,
) -> Identification:
    """Identify one model from one or more recordings of the same stage.

    progress: called with a few words as the work goes on. Raises BadRecording when the recordings
    cannot carry a model, in one sentence; BadInput when they do not belong together.
    """
    options = options or Options()
    if not recordings:
        raise BadInput("no recording was given")
    _same_units(recordings)
    _all_different(recordings)
    progress("reading the drive")
    spans = [float(np.nanmax(r.drive) - np.nanmin(r.drive)) for r in recordings if _has_drive(r)]
    rows = [prepare(r, max(spans, default=0.0)) for r in recordings]
    found = _search(set_up(rows, options.monotone), options, progress)
    if not _start_agrees(found.problem, found.residuals()):
        problem = set_up(rows, options.monotone, trust_start=False)
        found = _search(problem, options, progress)
        found.notes.append("the start does not fit a de-energised stage; it was left out")
    progress("intervals")
    return _result(found, recordings)


@dataclass
class _Found:
    """What the search ends with."""

    problem: Problem
    offset: float
    shape: Shape
    choice: Choice
    params: Params
    free: Bools
    tried: list[Candidate]
    notes: list[str]

    def residuals(self) -> tuple[Floats, ...]:
        """(N,) y - model of each recording."""
        return self.problem.residuals(self.choice.r, self.shape, self.params, self.offset)


def _search(problem: Problem, options: Options, progress: Callable[[str], None]) -> _Found:
    """Structure, outliers, thresholds, and the fit of all rows."""
    notes = list(problem.notes)
    wanted = shapes(options.rate, options.saturation, options.bias)
    if problem.rate_max <= 0.0:
        wanted = [s for s in wanted if not s.rate]
    tried = try_shapes(problem, wanted, progress)
    best = pick_shape(tried)
    for _ in range(3):
        params = best.solution.params
        errors = problem.residuals(first_grid(problem), best.shape, params, best.offset)
        problem, count = problem.without_outliers(errors)
        if count:
            notes.append(f"{count} lone displacement values far off their neighbours were left out")
        if count <= 1e-3 * errors[0].size:
            break
        tried = try_shapes(problem, wanted, progress)
        best = pick_shape(tried)
    _require_following(problem, best)
    while True:
        offset = best.offset
        progress("choosing the thresholds")
        choice = choose_thresholds(problem, best, options.order, wanted)
        shape = choice.shape
        progress(f"fitting {choice.r.size} operators to all rows")
        params, free = _fit_all(problem, choice, offset)
        turns = problem.margin(choice.r, shape, params, offset) < LEAST_SATURATION
        if not turns or not options.monotone or shape.powers == (0,):
            if shape != best.shape:
                notes.append(f"with invertible weights {shape.name} fits better and was taken")
            if choice.costly:
                notes.append(
                    "the data want an output that runs back right after a reversal, which no "
                    "invertible model can give; the nearest invertible model was taken"
                )
            if (size := sum(int(np.count_nonzero(p)) for p in problem.picks)) > ROWS_FITTED:
                notes.append(
                    f"of {size} rows a part, by chance, was fitted; the error is that of all"
                )
            return _Found(problem, offset, shape, choice, params, free, tried, notes)
        notes.append(f"{shape.name}: would turn over within reach and was not taken")
        wanted = [s for s in wanted if len(s.powers) < len(shape.powers)]
        same = [c for c in tried if (c.shape.rate, c.offset) == (shape.rate, offset)]
        fewer = [c for c in same if len(c.shape.powers) < len(shape.powers)]
        if not fewer:  # the user fixed the saturation: a straight line takes its place
            flat = Shape(shape.rate, (0,))
            fewer = try_shapes(problem, [flat], progress)
        best = pick_shape(fewer)


def _result(found: _Found, recordings: Sequence[Recording]) -> Identification:
    """The model and its worth."""
    problem, picks = found.problem, found.problem.picks
    some = thinned(picks, ROWS_FITTED)
    count = sum(int(np.count_nonzero(p)) for p in some)
    blocks = blocks_of(
        problem.rows, some, found.choice.r, found.offset, problem.rate_max, problem.sign
    )
    cov = parameter_covariance(blocks, found.shape, found.params, found.free, count)
    residuals = found.residuals()
    noise = float(np.nanmedian([rough_rms(e) for e in residuals]))
    power = sum(float(np.sum(e[p] ** 2)) for e, p in zip(residuals, picks, strict=True))
    size = sum(int(np.count_nonzero(p)) for p in picks)
    h = problem.hysteresis(found.choice.r, found.shape, found.params, found.offset)
    rate_max = problem.rate_max if found.shape.rate else 0.0
    if problem.least is not None and not invertible(
        h, problem.drive_min, problem.drive_max, rate_max
    ):  # the bounds should see to it; a model that cannot be inverted must never be written
        raise NotInvertible(
            f"{problem.rows[0].name}: no invertible model was found; fix a simpler one with "
            "--static --saturation 1"
        )
    model = Model(
        h,
        _validity(problem, problem.rows),
        recordings[0].drive_unit,
        recordings[0].displacement_unit,
        fit=Fit(float(np.sqrt(power / size)), found.choice.held_rms, noise),
        provenance=Provenance(
            source="dehyst identify",
            recordings=tuple((one.name, one.sha256) for one in recordings),
        ),
    )
    return Identification(
        model=model,
        residuals=residuals,
        used=tuple(picks),
        shape=found.shape,
        params=found.params,
        errors=Params.unpacked(np.sqrt(np.maximum(np.diag(cov), 0.0)), found.params),
        at_bound=~found.free,
        tried=tuple(found.tried),
        orders=found.choice.orders,
        noise_rms=noise,
        notes=(*(n for one in problem.rows for n in one.notes), *found.notes),
    )


def _has_drive(recording: Recording) -> bool:
    return bool(np.any(~recording.missing_drive))


def _same_units(recordings: Sequence[Recording]) -> None:
    first = recordings[0]
    for other in recordings[1:]:
        if (other.drive_unit, other.displacement_unit) != (
            first.drive_unit,
            first.displacement_unit,
        ):
            raise BadInput(
                f"{other.name} is in {other.drive_column}, {other.displacement_column} and "
                f"{first.name} in {first.drive_column}, {first.displacement_column}; "
                "one model needs one pair of units"
            )


def _all_different(recordings: Sequence[Recording]) -> None:
    seen: dict[str, str] = {}
    for one in recordings:
        if one.sha256 and one.sha256 in seen:
            raise BadInput(f"{one.name} holds the same as {seen[one.sha256]}; give it once")
        seen[one.sha256] = one.name


def _require_following(problem: Problem, best: Candidate) -> None:
    """Raise BadRecording when the displacement has little to do with the drive."""
    some = thinned(problem.picks, ROWS_FITTED)
    y = np.concatenate([one.y[p] for one, p in zip(problem.rows, some, strict=True)])
    explained = 1.0 - best.held_rms**2 / max(float(np.var(y)), 1e-300)
    if explained < LEAST_EXPLAINED:
        raise BadRecording(
            f"{problem.rows[0].name}: the displacement does not follow the drive (a model explains "
            f"{max(0.0, explained):.0%} of it); check the sensor, its cable and the columns"
        )


def _fit_all(problem: Problem, choice: Choice, offset: float) -> tuple[Params, Bools]:
    """Fit to all rows (of very many: to a part, by chance): the parameters, and which are free of
    their bound."""
    shape, r, pull = choice.shape, choice.r, choice.pull
    if pull is not None:
        some = [a | b for a, b in zip(*split(problem, ROWS_FINEST), strict=True)]
        fine, free_shape, start = choice.finest
        loose = fit_finest(problem, some, fine, free_shape, offset, start)
        pull = make_pull(problem, fine, free_shape, offset, loose.params)
    picks = thinned(problem.picks, min(ROWS_FITTED, MOST_HELD // r.size))
    count = sum(int(np.count_nonzero(pick)) for pick in picks)
    blocks = [*problem.blocks(picks, r, offset), *pull_blocks(problem, pull, r, offset, count)]
    low = lower_bounds(choice.params, problem.least)
    found = solve(lambda: blocks, shape, choice.params, low, prior_for(problem, r), steps=6)
    return found.params, found.free


def _start_agrees(problem: Problem, errors: Sequence[Floats]) -> bool:
    """Do the rows that depend on the assumed start state fit as the others do?"""
    early, late = [np.empty(0)], [np.empty(0)]
    for one, pick, error in zip(problem.rows, problem.picks, errors, strict=True):
        early.append(error[pick & ~one.settled])
        late.append(error[pick & one.settled])
    first, rest = np.concatenate(early), np.concatenate(late)
    if first.size == 0 or rest.size == 0:
        return True
    size = problem.slope * problem.span  # of the displacement's range
    bound = max(START_FACTOR * float(np.sqrt(np.mean(rest**2))), START_SHARE * size)
    return float(np.sqrt(np.mean(first**2))) <= bound


def _validity(problem: Problem, rows: Sequence[Rows]) -> Validity:
    bands = [b for one in rows if (b := drive_band_hz(one.u, one.period_s)) is not None]
    return Validity(
        drive_min=problem.drive_min,
        drive_max=problem.drive_max,
        rate_max=problem.rate_max or None,
        band_hz=max(bands, default=None),
        period_s=float(np.median([one.period_s for one in rows])),
    )
