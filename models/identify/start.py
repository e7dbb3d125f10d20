"""Whether a recording that looks as if the stage had been de-energised before it really is one.

A drive that starts at zero may follow an hour of exercise. Taken for de-energised all the same, the
stage would begin on the virgin curve, and the fit would bend every operator, and find lags, to make
up for it. The size of the first rows' misfit does not tell that, as the fit spreads it over all
rows. So what is fitted to all rows is held against what is fitted to those that no longer depend on
the start: where the start's rows cost these a good part of their fit, it is not what it looks like.
"""

import numpy as np

from dehyst.models.identify.data.outliers import thin
from dehyst.models.identify.dynamics import Dynamics
from dehyst.models.identify.equations import Shape
from dehyst.models.identify.fit import make_start
from dehyst.models.identify.lags import LagSearch
from dehyst.models.identify.setup import FitSetup
from dehyst.models.identify.structure import Trial, shows
from dehyst.models.identify.thresholds import space_thresholds
from dehyst.models.identify.tuning import TUNING
from dehyst.models.recording import Bools

POWERS = (0, 2, 3)


def start_agrees(setup: FitSetup, rate: bool) -> bool:
    """Do the rows that depend on the assumed start go together with the others?

    rate: the weights may depend on the rate. True where no start is assumed, or where too few rows
    are free of it.
    """
    some = thin(setup.picks, TUNING.rows_compared)
    settled = [pick & one.settled for pick, one in zip(some, setup.rows, strict=True)]
    count, total = (sum(int(np.count_nonzero(p)) for p in picks) for picks in (settled, some))
    if not setup.virgin or count == total or count < TUNING.fewest_rows:
        return True
    shape = Shape(rate and setup.rate_max > 0.0, POWERS)
    strengths = setup.strengths[::2]
    lag: Dynamics | None = None
    while True:
        assumed = _prepare(setup, some, shape, lag)
        known = Trial(setup, settled, assumed.r, 0.0, lag)
        known.linearise(assumed.like, shape, POWERS)
        with_start = assumed.score(shape, strengths, known.normals)
        without = known.score(shape, strengths)
        if not shows(with_start, without, TUNING.start_costs):
            return True
        if lag is not None:
            return False
        # unless it is a lag that makes the start look wrong
        found = LagSearch(setup, some, assumed.r, assumed.score(shape, strengths)).find()
        if found is None:
            return False
        lag = found.lag


def _prepare(setup: FitSetup, picks: list[Bools], shape: Shape, lag: Dynamics | None) -> Trial:
    """The equations of these rows about the straight fit."""
    r = space_thresholds(TUNING.lag_operators, setup.span, setup.virgin)
    trial = Trial(setup, picks, r, 0.0, lag)
    flat = Shape(shape.rate, (0,))
    start = make_start(r.size, flat, setup.slope, len(setup.rows))
    trial.linearise(start, flat, (0,))
    trial.linearise(trial.score(flat, (1.0,)).params, flat, shape.powers)
    return trial
