"""Constants of identification: counts, and levels that several decisions share."""

from typing import NamedTuple


class Tuning(NamedTuple):
    """Each decision compares with one of these levels. A share is a fraction of a power or misfit,
    of a range or span, or of the mean slope, as the code that uses it says. The values are judged
    by tests/benchmarks/models: prediction (structure, prior, comparison), outside (refusals, lags),
    coverage (the interval) and identify (damaged recordings, speed, length)."""

    # shares (1 = all)
    trace: float = 0.003  # smallest gain in fit that counts; smaller outliers do no harm
    crumb: float = 0.02  # negligible: a smaller gain in prediction is not worth a larger model
    small: float = 0.05  # may still be due to chance or to an unknown start
    minor: float = 0.1  # large enough to be reported or to decide
    quarter: float = 0.25  # of the misfit beyond noise: another start removes at most 0.16 of it
    # if the start is right, mostly 0.3 and more if not; also of the noise and of the stroke
    half: float = 0.5  # the larger part: a model that explains less explains too little
    most: float = 0.667  # of a power: if no more remains, the gain is plain without a test
    # ratios
    near: float = 1.3  # nearly equal: the error grows by this on another waveform
    twice: float = 2.0  # of an expected error: worse than it should be
    far: float = 4.0  # of a typical value: too far off to be of the same kind
    # deviations
    sure: float = 2.0  # standard errors: more than chance, if the gain shows in prediction
    certain: float = 5.0  # standard errors, or log odds: required if nothing else supports it
    wild: float = 6.0  # robust standard deviations: an outlier if its neighbours are ordinary
    # the recordings
    fewest_rows: int = 60  # rows: about as many as a model has unknowns
    most_rows: int = 2_000_000  # rows of a recording; a longer one is used in stretches, for time
    long_gap: float = 5.5  # sampling periods: in a longer gap the drive may have reversed unseen;
    # not a whole number, because gaps are whole periods
    slow_s: float = 0.5  # seconds: rows this far apart are slow; a drive held longer is at rest
    longest_lag_s: float = 10.0  # seconds, of any lag or delay: longer ones are creep or drift
    # the search
    rows_compared: int = 12_000  # rows for the choice of structure, which takes hundreds of fits
    folds: int = 8  # number of folds left out in turn: each fit keeps 7/8 of the rows
    pieces: int = 4  # per fold, so that 32 gains give a mean and its standard error
    parts: int = 16  # parts of a segment between two turns, or of a recording in time
    rounds: int = 3  # iterations, at most, that alternate between two interdependent estimates
    strengths: tuple[float, ...] = (1e-3, 1.0, 30.0, 1e3, 3e4)  # of the prior, dimensionless: the
    # first leaves slopes practically free; at 1 they differ by about the mean slope from the
    # narrowest operator to the widest; the last but one holds operators that hardly move
    rate_shares: tuple[float, ...] = (1e-3, 0.1, 0.3, 1.0, 3.0, 10.0)  # strength of the prior on
    # the rate-dependence over that on the slopes: from practically free to ten times as strong
    few_operators: int = 24  # operators for lags, start and couplings: each trial makes equations
    coarse: int = 32  # operators while structures are compared, which takes hundreds of fits
    # the last fit
    fine: int = 45  # operators: data cannot distinguish thresholds that are much closer
    spacing: float = 2.5  # power by which thresholds grow; with 3 (Eq. 10) a model of part of the
    # range predicts other drives in that range worse
    rows_fitted: int = 300_000  # rows: more lower the error by less than 1 nm and fill the memory
    stretches: int = 30  # stretches of time left out in turn for the intervals


TUNING = Tuning()
