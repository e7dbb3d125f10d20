"""The constants of identification, judged by two benchmarks: tests/benchmarks/models/prediction.py
(structure, prior, comparison) and tests/benchmarks/models/identify.py (rows and outliers by its
part `faults`, sizes by `speed` and `length`)."""

from typing import NamedTuple


class Tuning(NamedTuple):
    """Lengths in shares of the drive's span, slopes in shares of the mean slope, but where said."""

    # shares
    trace: float = 0.003
    crumb: float = 0.02
    small: float = 0.05
    minor: float = 0.1
    quarter: float = 0.25
    half: float = 0.5
    # times
    twice: float = 2.0
    far: float = 4.0
    rounds: int = 3
    # rows: what of a recording may stand as an equation
    fewest_rows: int = 60
    long_gap: float = 5.5  # periods; over a longer gap the drive may have turned unseen
    near_zero: float = 0.01  # still counts as de-energised
    steadier: float = 0.7  # the drive must be this much smoother by number than by time stamp
    # what cannot be drive and displacement of one stage
    slow_period_s: float = 0.5
    backward_loop: float = 0.01  # of its box, by which the drive runs behind
    reading_rougher: float = 3.0  # noise of the reading, of the drive's, both of their range
    another_waveform: float = 1.3  # times the errors of stretches left out: of one recording they
    # are of one waveform; several are each other's (tests/benchmarks/models/coverage.py)
    lone: float = 8.0  # a lone drive value this many robust standard deviations off is a glitch
    smallest_glitch: float = 0.004
    spike: float = 6.0  # a residual this many robust standard deviations off its neighbours
    smallest_spike: float = 0.004  # of the displacement's range; smaller ones do no harm
    # bounds and prior
    strengths: tuple[float, ...] = (1e-2, 1.0, 30.0, 1e3, 3e4)  # of the prior; 1: slopes differ by
    # about the mean slope from the narrowest operator to the widest
    rate_shares: tuple[float, ...] = (1e-3, 0.1, 0.3, 1.0, 3.0, 10.0)  # the same, by evidence
    bend: float = 0.03  # of the way over half the range, by which a saturation may well bend it
    bent: float = 5.0  # logarithm of the odds by which evidence must speak against a bend
    folds: int = 8
    pieces: int = 4  # of each fold
    parts: int = 16  # of a way between two turns
    sure: float = 2.0  # standard errors of the mean gain over folds, that a richer model must have
    clear: float = 0.6  # of the held-out power: a structure that leaves no more pays at once
    clear_lag: float = 0.85  # the same for a lag longer than a sampling period
    lag_operators: int = 24  # while a lag is sought, or the start judged
    clear_ways: float = 0.667  # of the power of these, at most
    coarse: int = 32  # operators while structures are compared
    fine: int = 48  # and in the model
    spacing: float = 2.5  # of these, the power by which thresholds grow; Eq. 10 has 3
    pull_noise: float = 1.073  # rms that bounds and pull may cost, against the fit without bounds
    pull_price: float = 1.4  # or the misfit that they may cost, against what the bounds alone cost
    costs: float = 0.005  # of the misfit: so much the bounds must cost before there is a pull
    start_shows: float = 0.07  # and of all of it, as it shows no more where noise hides the start
    farthest: float = 5.0  # an offset may lie this many spans from the middle of the drive
    # linear dynamics
    hopeless: float = 2.5  # times the best error: a static structure so far off needs no lag
    jitters: float = 5.0  # times the jitter of the readings in time, that a lag must be longer
    longest_lag_s: float = 10.0  # of any lag or delay: longer ones are creep or drift
    lag_nearby: tuple[float, ...] = (0.7, 1.0, 1.4)  # times the lag, where it is sought anew
    least_damping: float = 0.45  # below it rings: a resonance, and no lag
    sure_drift: float = 5.0  # standard errors of its slope
    # coupling from other axes, judged by tests/models/identify/test_coupling.py
    coupling_rest_s: float = 1.0  # of a rest, that counts
    coupling_settled: float = 0.2  # of the noise: a change of the gains that brings less is none
    # sizes
    most_rows: int = 2_000_000  # of a recording; of a longer one stretches are taken, so many:
    rows_compared: int = 12_000  # for the choice of the structure
    rows_fitted: int = 300_000  # for the last fit: more do not lower its error by a nanometre
    stretches: int = 30  # of time, for the intervals


TUNING = Tuning()
