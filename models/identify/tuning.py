"""The constants of identification: counts, and a ladder of levels on which its decisions stand."""

from typing import NamedTuple


class Tuning(NamedTuple):
    """Each decision stands on one of these steps, and several decisions share each. A share is a
    part of a power or a misfit, of a range or a span, or of the mean slope, as the code says. They
    are judged by tests/benchmarks/models: prediction (structure, prior, comparison), outside (what
    is refused; lags), coverage (the interval) and identify (damaged recordings, speed, length)."""

    # shares
    trace: float = 0.003  # the least gain in fit that counts, the least outlier that does harm
    crumb: float = 0.02  # next to nothing: a smaller gain in prediction is not worth a larger model
    small: float = 0.05  # what is still put down to chance, or to a start that is not known
    minor: float = 0.1  # worth a name
    quarter: float = 0.25
    half: float = 0.5
    most: float = 0.667  # of a power: where no more is left the gain is plain, without a test
    # times
    near: float = 1.3  # about the same, but for another waveform
    twice: float = 2.0  # worse than it should be
    far: float = 4.0  # of another kind
    # deviations
    sure: float = 2.0  # standard errors: more than chance, where the gain shows in prediction
    certain: float = 5.0  # standard errors, or logarithm of odds, where nothing else speaks for it
    wild: float = 6.0  # robust standard deviations: an outlier, if its neighbours are ordinary
    # the recordings
    fewest_rows: int = 60  # about as many as the model has unknowns
    most_rows: int = 2_000_000  # of a recording; of a longer one stretches are taken
    long_gap: float = 5.5  # periods; over a longer gap the drive may have turned unseen. Between
    # two whole numbers, as gaps are whole periods
    slow_s: float = 0.5  # rows so far apart are slow, and a drive at rest for so long is at rest
    longest_lag_s: float = 10.0  # of any lag or delay: longer ones are creep or drift
    # the search
    rows_compared: int = 12_000  # for the choice of the structure, which takes some hundred fits
    folds: int = 8  # left out in turn, each of
    pieces: int = 4  # over which gains are compared
    parts: int = 16  # of a way between two turns, or of a recording in time
    rounds: int = 3  # of two things that depend on each other, in turn
    strengths: tuple[float, ...] = (1e-3, 1.0, 30.0, 1e3, 3e4)  # of the prior; the first leaves
    # slopes as good as free, at 1 they differ by about the mean slope from the narrowest operator
    # to the widest, at the last but one those that hardly move are held
    rate_shares: tuple[float, ...] = (1e-3, 0.1, 0.3, 1.0, 3.0, 10.0)  # of the prior on what the
    # rate does, against that on the slopes
    few_operators: int = 24  # while a lag is sought, or the start judged
    coarse: int = 32  # operators while structures are compared
    # the last fit
    fine: int = 45  # operators; thresholds much closer cannot be told apart by data
    spacing: float = 2.5  # power by which thresholds grow; with Eq. 10's 3 a model of a part of the
    # range is worse on other drives in it
    rows_fitted: int = 300_000  # more do not lower its error by a nanometre, and fill the memory
    stretches: int = 30  # of time, left out in turn for the intervals


TUNING = Tuning()
