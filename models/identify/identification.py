"""Identify an invertible model from recordings, and estimate its error.

The structure is chosen first (dehyst.models.identify.structure, by hold-out on at most some
thousand rows), then that structure is fitted to all rows (dehyst.models.identify.fit). All
parameters of Eq. 6 of Qin et al. are found from one recording; their bounds keep the weights
monotone over the identified rate range.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np
from threadpoolctl import threadpool_limits

from dehyst.models.cascade.figures import describe
from dehyst.models.errors import BadInput, BadRecording, NotInvertible
from dehyst.models.hysteresis.z_range import is_invertible
from dehyst.models.identify.band import estimate_band, is_rival, is_stated, measure_spread
from dehyst.models.identify.choice import (
    count_picked,
    fit_chosen,
    make_choice,
    measure_left,
    shows_drift,
    without_ramp,
)
from dehyst.models.identify.data.rows import Rows, find_measured_range, read_rows
from dehyst.models.identify.data.stretches import take_stretches
from dehyst.models.identify.equations import Params
from dehyst.models.identify.final import Fitted, fit_all
from dehyst.models.identify.fit import make_start
from dehyst.models.identify.identified import Identification, Options, RecordingResidual
from dehyst.models.identify.plausibility.own_input import require_ordinary_loop, require_own_input
from dehyst.models.identify.plausibility.recordings import (
    require_better_than_a_line,
    require_different,
    require_drive_first,
    require_following,
    require_one_sense,
    require_one_stage,
    require_places,
    require_same_units,
    rms,
)
from dehyst.models.identify.setup import FitSetup, set_up
from dehyst.models.identify.start import start_agrees
from dehyst.models.identify.structure import TriedStructure
from dehyst.models.identify.tuning import TUNING
from dehyst.models.identify.uncertainty import (
    estimate_noise,
    fit_trend,
    leave_stretches_out,
    measure_band_hz,
    move_saturation,
)
from dehyst.models.model import Fit, Provenance, Validity
from dehyst.models.physics.dynamics import Dynamics
from dehyst.models.recording import Floats, Recording
from dehyst.models.signals.drive_segments import DriveSegments, has_one_size
from dehyst.models.signals.pace import measure_slowest_s
from dehyst.models.signals.rounding import quantum
from dehyst.models.units import how_many, spell_unit


@threadpool_limits.wrap(limits=1, user_api="blas")  # its threads wait for each other at this size
def identify_alone(
    recordings: Sequence[Recording],
    options: Options,
    progress: Callable[[str], None] = lambda text: None,
) -> Identification:
    """Identify one model from one or more recordings of the same stage, ignoring other axes.

    Very long recordings are used in stretches. Raises BadRecording when the recordings cannot carry
    a model, in one sentence; BadInput when they do not belong together.
    """
    if not recordings:
        raise BadInput("no recording was given")
    require_same_units(recordings)
    require_different(recordings)
    progress("reading the drive")
    taken = [take_stretches(one) for one in recordings]
    own = [one.recording for one in taken]
    try:
        found = _identify(own, options, progress)
    except BadRecording:
        require_ordinary_loop(own)  # gives a more specific reason than the general refusal
        raise
    return replace(
        found,
        residuals=tuple(x.spread(e, np.nan) for x, e in zip(taken, found.residuals, strict=True)),
        used=tuple(x.spread(k, False) for x, k in zip(taken, found.used, strict=True)),
        notes=(*(x.note for x in taken if x.note), *found.notes),
    )


def _identify(
    recordings: Sequence[Recording], options: Options, progress: Callable[[str], None]
) -> Identification:
    rows = [read_rows(r) for r in recordings]
    first = recordings[0]
    require_places(rows, spell_unit(first.drive_unit))
    require_drive_first(rows)
    require_one_sense(rows, f"{first.displacement_unit}/{spell_unit(first.drive_unit)}")
    setup = set_up(rows, options.monotone)
    agreed = start_agrees(setup, options.rate is not False)
    found = _search(setup if agreed else _leave_start(rows, options), options, progress)
    if options.rate is None and not found.fitted.shape.rate and setup.virgin:
        # the chosen model is static: a static fit may judge the start differently
        before, agreed = agreed, start_agrees(setup, False)
        if agreed != before:
            found = _search(setup if agreed else _leave_start(rows, options), options, progress)
    if not agreed:
        fewer = count_picked(setup.picks) - count_picked(_leave_start(rows, options).picks)
        rows_of_it = how_many(fewer, "row that depends on it was", "rows that depend on it were")
        found.notes.append(f"the start does not fit a de-energised stage; {rows_of_it} left out")
    found = _follow_drift(found, first.displacement_unit)
    residuals, picks = found.residuals(), found.setup.picks
    if len(rows) > 1 and (doubt := _require_one_stage(found, residuals, recordings, options)):
        found.notes.append(doubt)
    require_better_than_a_line(found.flat, found.residuals_without_drift(), picks)
    progress("intervals")
    result = _result(found, residuals, recordings)
    progress("simulating its own input")
    noises = [one.noise for one in result.recordings]
    said = require_own_input(result.model, found.setup.rows, result.used, noises)
    return replace(result, notes=(*result.notes, *said))


def _leave_start(rows: Sequence[Rows], options: Options) -> FitSetup:
    """Return the setup without the rows that depend on the start."""
    return set_up(rows, options.monotone, trust_start=False)


@dataclass
class _Found:
    """The result of the search. flat: the setup of the fit, from which a drift was subtracted."""

    setup: FitSetup
    flat: FitSetup
    best: TriedStructure
    coarse: Floats
    fitted: Fitted
    tried: list[TriedStructure]
    notes: list[str]
    drives: Sequence[DriveSegments]
    static_because: str = ""
    drifted: float = 0.0
    """Mean of the residuals at the end of a recording that drifts: added to the model's offset."""

    @property
    def params(self) -> Params:
        """Parameters of the model, with the offset of the end."""
        shape, params = self.fitted.shape, self.fitted.params
        end = self.setup.sign * self.drifted
        return params._replace(c=params.c + end * (np.array(shape.powers) == 0))

    @property
    def offset(self) -> float:
        """Drive offset."""
        return self.best.offset

    @property
    def lag(self) -> Dynamics | None:
        """Linear dynamics."""
        return self.best.lag

    def residuals(self) -> tuple[Floats, ...]:
        """Return y - model of each recording, (N,)."""
        f = self.fitted
        return f.setup.residuals(f.r, f.shape, self.params, self.offset, self.lag)

    def residuals_without_drift(self) -> tuple[Floats, ...]:
        """Return y - drift - model of each recording, (N,), as it was fitted."""
        f = self.fitted
        return self.flat.residuals(f.r, f.shape, f.params, self.offset, self.lag)


def _search(setup: FitSetup, options: Options, progress: Callable[[str], None]) -> _Found:
    """Choose the structure, remove outliers, and fit all rows."""
    chosen = make_choice(setup, options, progress)
    setup, search, tried, best = chosen.setup, chosen.search, chosen.tried, chosen.best
    notes = [*setup.notes, *chosen.notes]
    require_following(setup, best.held_rms)
    best, fitted = fit_chosen(chosen, options, progress, notes)
    if fitted.costly:
        notes.append(
            "the best fit would move against the drive right after a reversal, and could not be "
            "inverted; the nearest invertible model is used"
        )
    if (size := count_picked(setup.picks)) > TUNING.rows_fitted:
        notes.append(f"a random subset of the {size} rows was fitted; the error refers to all rows")
    if best.lag is not None and best.lag in search.untold:
        notes.append(best.lag.doubt)
    flat = setup
    if chosen.ramp:  # the fit is done: errors are those of the readings as they are
        setup, own = (without_ramp(one, -chosen.ramp) for one in (setup, fitted.setup))
        fitted = replace(fitted, setup=own)
    because = chosen.search.static_because
    return _Found(setup, flat, best, search.r, fitted, tried, notes, chosen.drives, because)


def _follow_drift(found: _Found, unit: str) -> _Found:
    """Return the model with the offset that the stage had at the end of its recording, if it
    drifts.

    The next recording begins where this one ended. With several recordings, each has its own offset
    and nothing is changed.
    """
    if len(found.setup.rows) != 1 or 0 not in found.fitted.shape.powers:
        return found
    if not shows_drift(found.drives):
        return found
    (error,), (pick,) = found.residuals(), found.setup.picks
    means = np.array([part.mean() for part in np.array_split(error[pick], TUNING.parts)])
    slope, doubt = fit_trend(means)
    if abs(slope) <= TUNING.certain * doubt:
        return found
    found.notes.append(
        f"the displacement drifts linearly, by {slope * means.size:+.3g} {spell_unit(unit)} over "
        "the recording; the model's offset is that at its end, and the stated interval does not "
        "include the drift"
    )
    return replace(found, drifted=float(means[-2:].mean()))


def _require_one_stage(
    found: _Found, residuals: Sequence[Floats], recordings: Sequence[Recording], options: Options
) -> str:
    """Raise BadRecording if one of several recordings is predicted much better by its own model; if
    it is a little better, return a remark for the user."""
    setup, f = found.setup, found.fitted
    start = replace(f.scored, params=make_start(f.r.size, f.shape, setup.slope, 1))
    alone, together, sizes = [], [], []
    for one, pick, error in zip(setup.rows, setup.picks, residuals, strict=True):
        if int(np.count_nonzero(pick)) < TUNING.fewest_rows:
            continue
        own = replace(setup, rows=[one], picks=[pick])
        # without the dynamics too: those of different stages together are no stage's
        starts = [start] if start.lag is None else [start, replace(start, lag=None)]
        lefts = [
            measure_left(one, fit_all(own, one, f.r, options.order), own.picks) for one in starts
        ]
        alone.append(min(*lefts, rms(error[pick])))
        together.append(rms(error[pick]))
        sizes.append(float(np.std(one.y[pick])))
    names = [one.name for one in setup.rows]
    if len(alone) < len(names):
        return ""
    return require_one_stage(names, together, alone, sizes, recordings[0].displacement_unit)


def _result(
    found: _Found, residuals: Sequence[Floats], recordings: Sequence[Recording]
) -> Identification:
    """Return the model with its residuals, intervals and error estimates."""
    fitted, picks = found.fitted, found.setup.picks
    setup = fitted.setup
    jackknife = leave_stretches_out(
        fitted.equations, fitted.shape, fitted.params, fitted.free, fitted.normal
    )
    cov = jackknife.covariance
    noises = [
        estimate_noise(e, quantum(one.y)) for e, one in zip(residuals, setup.rows, strict=True)
    ]
    noise = float(np.nanmedian(noises))
    own = np.concatenate([e[p] for e, p in zip(residuals, picks, strict=True)])
    left = rms(own)
    rivals = [c for c in found.tried if is_rival(found.best, c)]
    spread = measure_spread(found.flat, found.coarse, found.best, rivals)
    steady = None
    if found.drifted:  # claims hold next to a drift, which has a note of its own
        row = np.arange(own.size)
        own = own - np.polyval(np.polyfit(row, own, 1), row)
        steady = rms(own) * max(1.0, fitted.scored.held_rms / fitted.scored.fitted_rms)
    fit = Fit(left, fitted.held_rms(left), noise, steady_rms=steady)
    band = estimate_band(setup, fitted, found.offset, jackknife, (spread, noise))
    model = setup.model(fitted.r, fitted.shape, found.params, found.offset, found.lag)
    rates = setup.rates(fitted.r) if fitted.shape.rate else 0.0
    if setup.limits is not None and not is_invertible(
        model.hysteresis, setup.drive_min, setup.drive_max, rates
    ):  # the bounds should ensure this; a model that cannot be inverted must never be written
        raise NotInvertible(
            f"{setup.rows[0].name}: no invertible model was found; fix a simpler one with "
            "--static --saturation 1"
        )
    validity = _find_validity(setup)
    stroke = describe(replace(model, validity=validity)).stroke
    shown = is_stated(fit, band, stroke) and not has_one_size(found.drives)
    model = replace(
        model,
        validity=validity,
        drive_unit=recordings[0].drive_unit,
        displacement_unit=recordings[0].displacement_unit,
        fit=replace(fit, band=band if shown else None),
        provenance=Provenance(
            source="dehyst identify",
            recordings=tuple((one.name, one.sha256) for one in recordings),
        ),
    )
    errors = Params.unpacked(np.sqrt(np.maximum(np.diag(cov), 0.0)), fitted.params)
    if shift := setup.centre(found.offset) - model.hysteresis.u_offset:
        here = slice(errors.slopes.size, errors.slopes.size + errors.c.size)
        shift *= float(model.hysteresis.b.sum())
        errors = errors._replace(c=move_saturation(cov[here, here], fitted.shape.powers, shift))
    return Identification(
        model=model,
        residuals=tuple(residuals),
        used=tuple(picks),
        shape=fitted.shape,
        params=found.params,
        errors=errors,
        rates=setup.rates(fitted.r),
        at_bound=~fitted.free,
        tried=tuple(found.tried),
        orders=fitted.orders,
        noise_rms=noise,
        recordings=tuple(
            RecordingResidual(one.name, rms(e[p]), noise_of_one)
            for one, e, p, noise_of_one in zip(setup.rows, residuals, picks, noises, strict=True)
        ),
        chosen=found.best,
        static_because=found.static_because,
        notes=(
            *(n for one in setup.rows for n in one.notes),
            *found.notes,
        ),
    )


def _find_validity(setup: FitSetup) -> Validity:
    rows, slowest = setup.rows, []
    low, high = find_measured_range(rows)
    for one in rows:
        known = ~np.isnan(one.u)
        slowest.append(measure_slowest_s(one.t_s[known], one.u[known], setup.span))
    bands = [b for one in rows if (b := measure_band_hz(one.u, one.period_s)) is not None]
    return Validity(
        drive_min=low,
        drive_max=high,
        rate_max=setup.rate_max or None,
        acceleration_max=(setup.acceleration_max or None) if setup.by_turns else None,
        band_hz=max(bands, default=None),
        period_s=float(np.median([one.period_s for one in rows])),
        slowest_s=max(slowest) or None,
    )
