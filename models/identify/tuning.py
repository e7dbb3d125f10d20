"""The constants of identification, judged by two benchmarks: tests/benchmarks/models/prediction.py
(structure, prior, comparison) and tests/benchmarks/models/identify.py (rows and outliers by its
part `faults`, sizes by `speed` and `length`)."""

from typing import NamedTuple

import numpy as np


class Tuning(NamedTuple):
    """Lengths in shares of the drive's span, slopes in shares of the mean slope, but where said."""

    # rows: what of a recording may stand as an equation
    fewest_rows: int = 60
    long_gap: float = 5.5  # periods; over a longer gap the drive may have turned unseen
    near_zero: float = 0.01  # still counts as de-energised
    steadier: float = 0.7  # the drive must be this much smoother by number than by time stamp
    # what cannot be drive and displacement of one stage
    slow_period_s: float = 0.5
    smooth_step: float = 0.1  # of the span, by which a drive in the wrong unit of time still goes
    backward_loop: float = 0.01  # of its box, by which the drive runs behind
    reading_rougher: float = 3.0  # noise of the reading, of the drive's, both of their range
    no_worse: float = 1.0  # times the rms that a straight line leaves
    one_stage: float = 4.0  # times the rms of a model of its own, that the common one may leave
    less_alike: float = 2.0  # the same, from which on it is said
    most_excess: float = 0.1  # of the displacement's range, that a model may leave beyond the noise
    # in all rows of its own input: ordinary recordings leave 0.03 at most, those of another class
    # 0.2 and more (tests/benchmarks/models/outside.py)
    widest_band: float = 0.25  # of the stroke: a wider interval of prediction says nothing
    widest_loop: float = 0.5  # of the stroke; a piezo below its coercive field has 0.35 at most
    driven_pace: float = 0.99  # of the rows: slower ones are too few to show what is slow
    another_waveform: float = 1.3  # times the errors of stretches left out: of one recording they
    # are of one waveform; several are each other's (tests/benchmarks/models/coverage.py)
    worse_left_out: float = 2.0  # times the rms of the fitted rows, from which on it is said
    # outliers
    lone: float = 8.0  # a lone drive value this many robust standard deviations off is a glitch
    glitch_steps: float = 4.0  # and this many steps around it; where a drive turns it is below 2
    smallest_glitch: float = 0.004
    spike: float = 6.0  # a residual this many robust standard deviations off its neighbours
    usual_rows: float = 1e4  # of more, chance alone puts some further off
    most_outliers: float = 0.05  # of the rows
    smallest_spike: float = 0.004  # of the displacement's range; smaller ones do no harm
    # bounds and prior
    least_slope: float = 0.02  # the lowest slope a model may have after a reversal
    most_slope: float = 4.0  # and the highest
    least_saturation: float = 0.05  # of the mean slope of the saturation
    narrow: float = 0.02  # narrower operators may at first run the wrong way
    strengths: tuple[float, ...] = (1e-2, 1.0, 30.0, 1e3, 3e4)  # of the prior; 1: slopes differ by
    # about the mean slope from the narrowest operator to the widest
    weighed: tuple[float, ...] = (1e-2, 1.0, 3.0, 10.0, 30.0, 100.0, 300.0, 1e3, 3e4)  # by evidence
    alone: float = 1e-3  # the most strength among narrow operators, where they are free
    wide: float = 1e3  # the least strength, among operators wider than half the range
    rate_strength: float = 1e-3  # of the prior on what the rate does, against that on the slopes
    rate_shares: tuple[float, ...] = (1e-3, 0.1, 0.3, 1.0, 3.0, 10.0)  # the same, by evidence
    bend: float = 0.03  # of the way over half the range, by which a saturation may well bend it
    bent: float = 5.0  # logarithm of the odds by which evidence must speak against a bend
    nearby: float = 0.05  # the way that tells the direction at the start
    # structure
    folds: int = 8
    pieces: int = 4  # of each fold
    parts: int = 16  # of a way between two turns
    turn: float = 0.05  # a smaller way back is no turn
    alike: float = 0.1  # ways whose ends differ by less are one
    sure: float = 2.0  # standard errors of the mean gain over folds, that a richer model must have
    tolerance: float = 0.02  # of the held-out power: less is not worth a larger model
    climb: float = 0.003  # of the misfit, that a power of z must take away to show in the fit
    clear: float = 0.6  # of the held-out power: a structure that leaves no more pays at once
    clear_lag: float = 0.85  # the same for a lag longer than a sampling period
    lag_operators: int = 24  # while a lag is sought, or the start judged
    clear_rate: float = 0.1  # the same for rate-dependence, which else must predict whole ways
    clear_ways: float = 0.667  # of the power of these, at most
    clear_beyond: float = 0.1  # of their power beyond the noise: then it is asked no more
    coarse: int = 32  # operators while structures are compared
    fine: int = 45  # and in the model
    finest: int = 48  # where the number in the model is given, before some are dropped
    spacing: float = 2.5  # of these, the power by which thresholds grow; Eq. 10 has 3
    beyond_half: int = 5  # of these, wider than half the span where the virgin curve was driven
    # of the comparison drive, against all rows: the largest that keeps the price
    pull_shares: tuple[float, ...] = tuple((0.01 * 1.4 ** np.arange(16)).tolist())
    pull_noise: float = 1.073  # rms that bounds and pull may cost, against the fit without bounds
    pull_price: float = 1.4  # or the misfit that they may cost, against what the bounds alone cost
    costs: float = 0.005  # of the misfit: so much the bounds must cost before there is a pull
    least_explained: float = 0.5  # of the displacement's power, held out: else it does not follow
    start_costs: float = 0.25  # of the misfit beyond the noise, that another start must take away;
    # at true starts it took at most 0.16, at others mostly 0.3 and more
    start_shows: float = 0.07  # and of all of it, as it shows no more where noise hides the start
    start_moves: tuple[float, ...] = (0.5, 1.0)  # of the way: these other starts
    rows_at_start: int = 1_000_000  # of a recording, by which its start is judged
    farthest: float = 5.0  # an offset may lie this many spans from the middle of the drive
    # linear dynamics
    worth_trying: float = 0.003  # of the misfit, that a first try must take away
    strays: float = 2.0  # times the error that was predicted, that a fit to all rows may leave
    hopeless: float = 2.5  # times the best error: a static structure so far off needs no lag
    jitters: float = 5.0  # times the jitter of the readings in time, that a lag must be longer
    longest_lag: float = 0.5  # of the time in which the drive at its fastest crosses its range
    longest_lag_s: float = 10.0  # of any lag or delay: longer ones are creep or drift
    lag_rounds: int = 3  # of a lag and the structure beside it, in turn
    lag_nearby: tuple[float, ...] = (0.7, 1.0, 1.4)  # times the lag, where it is sought anew
    lag_settled: float = 0.02  # of the lag: a smaller change is none
    least_damping: float = 0.45  # below it rings: a resonance, and no lag
    blocks: int = 20  # of time, whose means tell a drift
    sure_drift: float = 5.0  # standard errors of its slope
    # coupling from other axes, judged by tests/models/identify/test_coupling.py
    coupling_plays: int = 12  # on the own drive, by which a channel is cleared of it
    coupling_stretches: int = 16  # of time, of each recording
    coupling_moves: float = 0.1  # of the mean power of a channel, that it has where it moves
    coupling_pays: float = 0.05  # of the held-out power, where the channel moves
    coupling_still: float = 1e-6  # of the span: a drive that changes less stands
    coupling_rest_s: float = 1.0  # of a rest, that counts
    coupling_rounds: int = 3  # of model and gains in turn
    coupling_settled: float = 0.2  # of the noise: a change of the gains that brings less is none
    # sizes
    most_rows: int = 2_000_000  # of a recording; of a longer one stretches are taken, so many:
    long_stretches: tuple[int, ...] = (4, 2, 1)
    stretch_range: float = 0.9  # of the drive's range, that each of them runs through
    rows_compared: int = 12_000  # for the choice of the structure
    rows_slope: int = 1_000_000  # for the mean slope
    rows_fitted: int = 1_000_000  # for the last fit: more do not lower its error by a nanometre
    most_held: int = 30_000_000  # numbers in the equations of the last fit
    stretches: int = 30  # of time, for the intervals


TUNING = Tuning()
