"""The constants of the diagnosis, set by tests/benchmarks/models/diagnosis.py on its tuning set
(seeds 1000 to 1059: naming, false alarms, error held out)."""

from typing import NamedTuple


class Tuning(NamedTuple):
    """`size`: rms, in rms of the noise; `share`: part of the power beyond the noise."""

    # the recordings
    least_samples: int = 200
    time_blocks: int = 5  # of each recording, in which an effect must be the same
    folds: int = 8  # groups left out in turn, each of so many short pieces of every recording:
    fold_pieces: int = 5
    long_gap: int = 100  # samples: behind a longer one the recording begins anew
    few_of_grid: float = 2.2  # mean step over the shortest: with more, two rates are mixed
    stall: int = 3  # missing samples in a row, from which on the drive's way is not known
    settling: int = 20  # rows left out behind a stall, at least; and times its length:
    settling_times: int = 2
    few_missing: float = 0.02  # of the samples: with more, the noise is that of neighbours
    segment: int = 256  # samples of a spectrum, for the noise
    ridge: float = 1e-9  # of the additive columns' mean square: against exact collinearity only
    shared_parts: int = 24  # arrays of all samples, that simulations at the same weights keep
    # the search
    search_rows: int = 18_000  # counted in it; the last fit, shares and intervals use them all
    most_rows: int = 60_000  # of longer recordings a part is fitted
    max_effects: int = 5
    shortlist: int = 5  # candidates that get the full nonlinear refit in each round
    further: float = 0.5  # of a candidate's best start: another one with more is refitted too
    weak_gain: float = 0.1  # of the best screened gain: what is below is not refitted
    budget: int = 240  # full solutions after which it adds no more effects
    price: float = 16.0  # of a parameter, in noise variances; the number of candidates is in it
    tie: float = 0.12  # a simpler cause that leaves no more than this size beside the best is taken
    other_first: float = 0.7  # of the first pick's gain: another first pick is tried too
    other_than_last: float = 0.5  # the same, where that was a drift with structure beside it
    few_turns: int = 3  # with fewer turns of the drive nothing that it causes can be reported
    # what a cause must remove
    driven_share: float = 0.12  # where the drive causes it
    driven_size: float = 0.17
    static_size: float = 0.3  # where it resembles a hysteresis of another shape
    as_a_line: float = 0.9  # of a mode's gain, that a line may make of one loop alone
    one_loop_size: float = 0.5  # where the drive causes it, and goes round one loop alone
    sure_size: float = 0.18  # the same, where it takes much and is the same everywhere:
    sure_share: float = 0.45
    sure_spread: float = 0.2
    free_size: float = 0.12  # where it lies beside the drive
    part_share: float = 0.02  # for one more part (a mode) of a chosen effect
    finest: float = 2.5e-4  # of the displacement's range: no base is better than this,
    finest_static: float = 5e-4  # nor than this, for what resembles a hysteresis
    between_size: float = 1.0  # of the noise, that straight lines between samples must miss for the
    # drive's path to be laid finer,
    between_left: float = 0.1  # so that so much is missed,
    between_most: int = 10  # and at most so many times;
    between_smooth: float = 0.3  # of what lines miss of every second sample, that a spline may
    between: float = 0.25  # of what the drive does between two samples, that a loop may show of it
    quiet_times: float = 2.0  # size of the misfit from which, and
    quiet_size: float = 1e-3  # part of the displacement's range up to which it is the base's own,
    quiet_share: float = 0.4  # so that a cause must take more of it
    compact_share: float = 0.3  # over a compact base
    few_places_share: float = 0.75  # the same where the drive is seen in few places alone,
    places_enough: float = (
        1.3  # times a compact base's columns, for a late cause to be reported there;
    )
    # with fewer the displacement must move against the drive
    few_places_sure: float = 0.4  # and relative half width of what is reported there
    compact_doubt: float = 1.5  # held-out over in-sample rms of the rich base: a compact one too
    early_share: float = 0.4  # for a drive half a sample earlier
    early_size: float = 0.5
    stepped_size: float = 0.5  # for lags and modes that are fed by steps:
    stepped_share: float = 0.4  # of what one fed by straight lines leaves
    stepped_fades: float = 0.1  # of a recording, in which a mode's oscillation falls to 1/e
    past_beside: float = 0.5  # of what is left (rms), that what began before must take away
    distorted: float = 0.7  # of the held-out mean square with a given model under the base: where
    # the base leaves less than this without it, it stands alone
    noise_again: float = 0.7  # of the noise at first: below, the effects are looked for again
    follows_late: float = 0.2  # of the unexplained, where a displacement that comes back is late
    # what is worth telling, by held-out samples
    helps: float = 0.1  # size that an effect must remove
    helps_share: float = 0.002  # the same as a share of the misfit at first
    helps_rest: float = 0.1  # and of the misfit left: less is its own scatter
    beside_driven: float = 0.5  # a second cause of this size is reported beside any other,
    beside_free: float = 0.3  # where it lies beside the drive, of this
    # near-ties
    echo: float = 0.2  # of a finding that it ties with: a smaller one is what that one leaves
    rival_near: float = 0.02  # of the effect's gain: closer than this cannot be distinguished
    rival_noise: float = 0.15  # a difference of a smaller size is none
    rival_most: float = 0.25  # of the effect's gain, that a rival may leave in any case
    rival_promises: float = 0.5  # of it, that the screen makes of one that no round has tried
    rival_instead: float = 0.5  # of it, that the effect may take beside a rival that stands for it
    # the verdict
    structure_left: float = 0.45  # size that counts as structure left over
    surely_nothing: float = 0.25  # size that the noise's own estimate may be off by
    explained_left: float = 0.15  # share of the first that may be left when things are explained,
    explained_small: float = 0.5  # and where what is left is below structure
    explained_best: float = 0.01  # of what the model in use leaves: less is always explained
    recordings_enough: int = 3  # to leave out whole ones: one of two may be alone of its kind
    near_noise: float = 1.5  # times its rms, that held-out rows may be left with when explained
    # limits
    limit_rows: int = 6_000  # counted where it is asked again with an effect put in,
    limit_shortlist: int = 3  # and candidates that get the full refit then; where it takes all of
    limit_near: float = 0.5  # it, only those that promise such a part of what it gains
    limit_left: float = 1.0  # size of what is left, above which no effect of the drive is excluded
    limit_beside: int = 3  # effects found, beside which none of the drive is excluded either
    limit_driven: float = 0.5  # size at which it is asked first, where the drive causes it,
    limit_free: float = 0.35  # and where it lies beside the drive
    # shape
    shape_size: float = 0.3  # size that the base must remove of held-out samples,
    shape_share: float = 0.03  # and share of what the model in use leaves
    reach_room: float = 0.25  # of the stroke: an augmented model that leaves it further is not kept
    mostly_shape: float = 0.7  # of what is explained: more that effects leave to the base is shape
    foreign_share: float = 0.03  # of the stroke: a given model that leaves more, and
    foreign_times: float = 4.0  # times what a model of its class would, is of another stage
    no_worse: float = 0.5  # of the noise, that a written model's worst recording may leave more
    leanings: tuple[float, ...] = (1e-6, 1e-3, 1e-2, 0.1)  # weights by which a base is held to the
    # model in use where nothing was recorded, of the recorded rows; the first that holds it
    stiffnesses: tuple[float, ...] = (1e4, 1e2, 1.0)  # times the prior of the base, tried in turn
    # intervals
    widest: float = 10.0  # factor that an interval may span
    interval_width: float = 1.96  # standard deviations of white noise; blocks: Student's t
    largest_leverage: float = 0.99  # determined by one block alone: taken for no more than this
    bound_margin: float = 0.02  # of the (log) range: closer to a bound counts as on it


TUNING = Tuning()
