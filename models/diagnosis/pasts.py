"""How the memory of the drive's path began in each recording: as a hysteresis of any shape, fitted
behind each past, tells.

A recording that begins where another one ended does not climb the virgin curve. Taken for
de-energised, its wide operators would move where the stage's do not, and what they miss would look
like a step, or a loop of another shape, as large as most of what a diagnosis looks for.
"""

from dataclasses import replace

import numpy as np

from dehyst.models.diagnosis.base import rich_base
from dehyst.models.diagnosis.fit import Problem
from dehyst.models.diagnosis.tuning import TUNING
from dehyst.models.signals.joined import Data
from dehyst.models.signals.pasts import FROM_ABOVE, FROM_BELOW

BETTER = 0.05  # of the mean square, that a past must take away to be believed


def begin_as_found(data: Data) -> Data:
    """The same, with the marks of `forgets` that fit best; one recording after the other, and
    de-energised where nothing tells. A recording that counts from its first samples on is taken as
    de-energised: a wrong past would only stand for what is to be found."""
    light = Problem(data, rich_base(data)).light(TUNING.search_rows)
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
