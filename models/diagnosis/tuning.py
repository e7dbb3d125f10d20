"""The constants of the diagnosis: counts, and a scale of levels for its decisions."""

from typing import NamedTuple

from dehyst.models.signals.error_size import Z95


class Tuning(NamedTuple):
    """A size is an rms, relative to the rms of the noise; a share is a fraction of a power. Each
    decision uses one of these levels, and several decisions share each: none is set for one kind of
    recording. tests/benchmarks/models/proof measures how well they work."""

    # sizes
    trace: float = 0.12  # detectable at all, in hundreds of held-out samples
    visible: float = 0.17  # detectable if caused by the drive: the base's own errors are smaller
    clear: float = 0.3  # detectable if like a loop of another shape
    strong: float = 0.5  # clearly larger than everything else
    near: float = 1.5  # factor: about the same
    # shares
    crumb: float = 0.02  # negligible
    minor: float = 0.12  # worth reporting
    quarter: float = 0.25
    half: float = 0.5
    most: float = 0.7
    # the recordings
    least_samples: int = 200
    time_blocks: int = 5  # per recording; an effect must be the same in all
    folds: int = 8  # groups left out in turn, each of time_blocks pieces of every recording
    long_gap: int = 100  # samples: after a longer one the recording starts again
    few_of_grid: float = 2.2  # mean step over the shortest: above, two rates are mixed
    stall: int = 3  # missing samples in a row: from here on the drive's path is not known
    settling: int = 20  # rows left out after a stall, at least
    segment: int = 256  # samples per spectrum, for the noise
    few: int = 3  # recordings, turns, effects or candidates: fewer are too few to generalise
    between_most: int = 10  # largest refinement of the drive's path
    finest: float = 2.5e-4  # of the displacement's range: smallest error of any base; twice
    # for what resembles a loop; up to four times, the base's own where noise is far below
    foreign_times: float = 4.0  # times what a model fitted here leaves: more means another stage
    # the search
    search_rows: int = 9_000  # counted in the search; last fit, shares and intervals use all rows
    limit_rows: int = 6_000  # counted when the search is repeated with an added effect
    most_rows: int = 60_000  # longer recordings are fitted in part
    max_effects: int = 5
    shortlist: int = 5  # candidates that get the full nonlinear refit in each round
    budget: int = 240  # full solutions, after which no more effects are added
    price: float = 16.0  # of a parameter, in noise variances; accounts for the number of candidates
    shared_parts: int = 24  # arrays of all samples cached by simulations at the same weights
    ridge: float = 1e-9  # of the additive columns' mean square: against exact collinearity only
    # what is written
    leanings: tuple[float, ...] = (1e-6, 1e-3, 1e-2, 0.1)  # weights that pull a base towards
    # the model in use where nothing was recorded, relative to the recorded rows; first that works
    stiffnesses: tuple[float, ...] = (1e4, 1e2, 1.0)  # factors on the base's prior, tried in turn
    widest: float = 10.0  # factor that an interval may span
    interval_width: float = Z95  # for white noise; for blocks Student's t


TUNING = Tuning()
