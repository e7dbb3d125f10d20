"""The constants of the diagnosis: counts, and a ladder of levels at which something is told."""

from typing import NamedTuple


class Tuning(NamedTuple):
    """A size is an rms, in rms of the noise; a share is a part of a power. Each decision stands on
    one of these steps, and several decisions share each: none is set for one kind of recording.
    What they are worth is measured by tests/benchmarks/models/proof."""

    # sizes
    trace: float = 0.12  # what shows at all, in hundreds of held-out samples
    visible: float = 0.17  # what the drive causes: the base's own error looks like it below
    clear: float = 0.3  # what resembles a loop of another shape
    strong: float = 0.5  # what stands out beside anything else
    near: float = 1.5  # times: about the same
    # shares
    crumb: float = 0.02  # next to nothing
    minor: float = 0.12  # worth a name
    quarter: float = 0.25
    half: float = 0.5
    most: float = 0.7
    # the recordings
    least_samples: int = 200
    time_blocks: int = 5  # of each recording, in which an effect must be the same
    folds: int = 8  # groups left out in turn, each of time_blocks pieces of every recording
    long_gap: int = 100  # samples: behind a longer one the recording begins anew
    few_of_grid: float = 2.2  # mean step over the shortest: with more, two rates are mixed
    stall: int = 3  # missing samples in a row, from which on the drive's way is not known
    settling: int = 20  # rows left out behind a stall, at least
    segment: int = 256  # samples of a spectrum, for the noise
    few: int = 3  # recordings, turns, effects or candidates: fewer show no rule
    between_most: int = 10  # times that the drive's path is laid finer, at most
    finest: float = 2.5e-4  # of the displacement's range: no base is better than this; twice it
    # for what resembles a loop, up to four times it is the base's own where noise is far below
    foreign_times: float = 4.0  # what a model of its class would leave: another stage's leaves more
    # the search
    search_rows: int = 18_000  # counted in it; the last fit, shares and intervals use them all
    limit_rows: int = 6_000  # counted where it is asked again with an effect put in
    most_rows: int = 60_000  # of longer recordings a part is fitted
    max_effects: int = 5
    shortlist: int = 5  # candidates that get the full nonlinear refit in each round
    budget: int = 240  # full solutions after which it adds no more effects
    price: float = 16.0  # of a parameter, in noise variances; the number of candidates is in it
    shared_parts: int = 24  # arrays of all samples, that simulations at the same weights keep
    ridge: float = 1e-9  # of the additive columns' mean square: against exact collinearity only
    # what is written
    leanings: tuple[float, ...] = (1e-6, 1e-3, 1e-2, 0.1)  # weights by which a base is held to the
    # model in use where nothing was recorded, of the recorded rows; the first that holds it
    stiffnesses: tuple[float, ...] = (1e4, 1e2, 1.0)  # times the prior of the base, tried in turn
    widest: float = 10.0  # factor that an interval may span
    interval_width: float = 1.96  # standard deviations of white noise; blocks: Student's t


TUNING = Tuning()
