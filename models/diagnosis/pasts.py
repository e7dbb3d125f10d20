"""Find how the memory of the drive's path began in each recording, by fitting a hysteresis of any
shape with each past, and whether that past explains the recording's head, so that it counts.

A recording that begins where another one ended does not follow the virgin curve. If it is taken as
de-energised, the model's wide operators move where the stage's do not, and the error looks like a
step, or a loop of another shape, as large as most of what a diagnosis looks for.
"""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from dehyst.models.diagnosis.base import rich_base
from dehyst.models.diagnosis.fit import Problem
from dehyst.models.diagnosis.joint_fit import JointFit
from dehyst.models.diagnosis.tuning import TUNING
from dehyst.models.signals.error_size import rms
from dehyst.models.signals.joined import Bools, Data
from dehyst.models.signals.pasts import FROM_ABOVE, FROM_BELOW

BETTER = 0.05  # share of the mean square that a past must remove to be accepted
AS_WELL = 1.15  # largest rms of a head, times that of the other rows
NO_WORSE = 0.15  # of the noise: allowed increase of what the other rows leave


def choose_pasts(data: Data) -> Data:
    """Return the same data with the marks of `forgets` that fit best, found one recording after the
    other; de-energised where nothing distinguishes them. A recording that counts from its first
    samples on is taken as de-energised: a wrong past would only absorb what is to be found."""
    light = Problem(data, rich_base(data)).with_fewer_rows(TUNING.search_rows)
    best, least = light.data, light.solve([]).sse
    for first in np.flatnonzero(data.forgets).tolist():
        if data.rows[first : first + TUNING.settling].any():
            continue
        for past in (FROM_ABOVE, FROM_BELOW):
            marks = best.forgets.copy()
            marks[first] = past
            trial = replace(light.data, forgets=marks)
            left = replace(light, data=trial).solve([]).sse
            if left < (1.0 - BETTER) * least:
                best, least = trial, left
    return replace(data, forgets=best.forgets)


def explained_heads(problem: Problem, fitted: JointFit, sigma: float) -> list[int]:
    """Return the recordings whose heads a fit's effects and the base explain as well as the rest,
    with the pasts that were found: for these, what happened before is known."""
    data = problem.data
    out = [i for i in range(len(data.names)) if np.any(data.heads & (data.rec == i))]
    before = fitted.residual(data)
    while out:
        there = replace(problem, data=replace(data, rows=rows_with_heads(data, out)))
        left = there.solve(fitted.effects, problem.output_of(fitted)).residual(data)
        wrong = []
        for i in out:
            here = data.rec == i
            rest = here & data.rows
            usual = max(rms(before[rest]) if rest.any() else 0.0, sigma)
            head = rms(left[here & data.heads])
            if head > AS_WELL * usual:
                wrong.append(i)
        if not wrong:
            more = np.mean(left[data.rows] ** 2) - np.mean(before[data.rows] ** 2)
            return out if more < (NO_WORSE * sigma) ** 2 else []
        out = [i for i in out if i not in wrong]
    return out


def rows_with_heads(data: Data, recordings: Sequence[int]) -> Bools:
    """Return the (N,) rows that count, including the heads of some recordings."""
    return data.rows | (data.heads & np.isin(data.rec, recordings))
