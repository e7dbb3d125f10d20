"""The inverse's constants, in one place.

They were set with `python -m tests.benchmarks.models.inverse`: its tracking table on Eq. 12
(window), and its random models (fallback). Durations are in seconds, lags in samples; "slope" is
the mean |dy/du| over the range, "noise" is the model's noise.
"""

from typing import NamedTuple


class Tuning(NamedTuple):
    """One frozen set of constants; the kernels compile them in."""

    # How far a model is used (--only stage, and the test of the choice).
    rate_margin: float = 1.25  # highest rate of a rate-dependent model, times its validity's rate
    noise_share: float = 0.004  # noise as part of the stroke, where the model states none
    too_far: float = 0.1  # of the stroke: further from monotone, only the static inverse is used
    secants: int = 12  # most iterations for blocks parallel to the hysteresis
    # Window: nodes, and the cost of a plan (tracking table).
    node_s: float = 1e-3  # spacing of nodes, for loops that are faster
    smooth: float = 0.7  # weight of the second difference at 1 ms nodes, times slope^2
    least_smooth: float = 0.01  # lower limit of its factor for wider spacing, against zigzag
    stiff_end: float = 400.0  # the terminal cost: smoothness grows by
    stiff_power: int = 6  # 1 + stiff_end (j / P)^stiff_power
    spring: float = 300.0  # stiffness beyond drive range and rate, times slope^2
    # Sweeps (tracking table, speed).
    sweeps: int = 2  # per node
    first_sweeps: int = 8  # for a new plan
    worth: float = 0.03  # of the cost, or of the noise's: a sweep that gains less is the last
    most_damping: float = 7.0  # times slope^2
    # Fallback: plan against static inverse within the window (random models).
    allowance: float = 0.25  # part of the noise by which a plan in use may be worse, rms
    gain: float = 0.7  # part of the static error: a plan below it is taken up again
    looks: int = 4  # places along the window where they are compared
    clear: float = 1.5  # times the noise: above this static error a good plan needs no comparison
    gone: float = 1e-5  # of the drive range: a smaller gap is set to 0
    lost: float = 2.0  # times the static error: a worse plan is replaced by the static inverse
    # Continuation of targets without look-ahead (tracking table, causal).
    causal_window_s: float = 0.1
    slope_fades_s: float = 0.06
    bend_fades_s: float = 0.02
    trust_fades_s: float = 0.04
    seen_margin: float = 0.25  # of the range of all targets until now: margin for the continuation
    # Whole trajectory (tracking table).
    whole_smooth: float = 0.01  # as `smooth`
    whole_sweeps: int = 150
    refinements: int = 60
    settled: float = 1e-6  # relative gain below which a round counts as stalled
    refined_samples: int = 200_000  # longer trajectories are not refined
    arrived: float = 3.0  # times the noise: an error below this is the first arrival
    settles_s: float = 0.02  # after the first arrival, until the approach counts as over


TUNING = Tuning()
