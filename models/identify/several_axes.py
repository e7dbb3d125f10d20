"""Identify one axis of several: the axis itself, and its coupling from the others."""

from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np
from threadpoolctl import threadpool_limits

from dehyst.models.identify.coupling import (
    Coupled,
    couple,
    find_other_axes,
    uncouple,
    with_couplings,
    without_rests,
)
from dehyst.models.identify.identification import identify_alone
from dehyst.models.identify.identified import Identification, Options
from dehyst.models.identify.tuning import TUNING
from dehyst.models.recording import Floats, Recording


def _keep_quiet(text: str) -> None:
    """Ignore the progress."""


@threadpool_limits.wrap(limits=1, user_api="blas")
def identify(
    recordings: Sequence[Recording],
    options: Options | None = None,
    progress: Callable[[str], None] = _keep_quiet,
) -> Identification:
    """Identify one model from one or more recordings of the same stage.

    Channels of other axes of the stage (`axis.y`) are kept in the model as coupling if that pays on
    held-out stretches; model and gains are fitted alternately. progress: called with a short text
    at each stage of the work. Raises BadRecording when the recordings cannot carry a model, in one
    sentence; BadInput when they do not belong together.
    """
    options = options or Options()
    if not recordings or not find_other_axes(recordings):
        return identify_alone(recordings, options, progress)
    progress("coupling from other axes")
    couplings = couple(recordings, [_displacement(one) for one in recordings])
    for _ in range(TUNING.rounds):
        before = couplings
        own = [without_rests(uncouple(one, before)) for one in recordings]
        found = identify_alone(own, options, progress)
        couplings = couple(recordings, _used(found), before)
        moved = [
            abs(new.gain - old.gain) * float(np.nanstd(one.channels[new.channel]))
            for old, new in zip(before, couplings, strict=False)
            for one in recordings
        ]
        settled = TUNING.quarter * found.noise_rms
        if len(couplings) == len(before) and max(moved, default=0.0) <= settled:
            break
    if not before:
        return found
    unit = found.model.displacement_unit
    return replace(
        found,
        model=with_couplings(found.model, before),
        couplings=tuple(before),
        notes=(*found.notes, *(_tell(one, unit) for one in before)),
    )


def _displacement(one: Recording) -> Floats:
    """Return the displacement (N,), NaN if there is none."""
    empty = np.full(one.size, np.nan)
    return empty if one.displacement is None else one.displacement


def _used(found: Identification) -> list[Floats]:
    """Return the residuals of the model, NaN where a row was not fitted."""
    pairs = zip(found.residuals, found.used, strict=True)
    return [np.where(used, error, np.nan) for error, used in pairs]


def _tell(one: Coupled, unit: str) -> str:
    """Describe a coupling in words."""
    return (
        f"{one.channel} moves this axis by {one.gain:+.3g} {unit} per unit: the model includes it "
        f"(held-out error while it moves: {one.before:.3g} {unit} without, {one.after:.3g} with)"
    )
