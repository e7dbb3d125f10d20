"""The inverse's constants, in one place.

Set by `python -m tests.benchmarks.models.inverse`: the tracking table on Eq. 12 (window), and its
random models (fallback). Lengths of time are in seconds, lags in samples; "slope" is the mean
|dy/du| over the range, "noise" the model's.
"""

from typing import NamedTuple


class Tuning(NamedTuple):
    """One frozen set; the kernels read it as constants."""

    # What a model is used for (`stage`, and the chooser's test).
    rate_margin: float = 1.25  # a rate-dependent model, up to this multiple of its validity's rate
    noise_share: float = 0.004  # of the stroke: the noise, where the model states none
    too_far: float = 0.1  # part of the stroke: a nearest monotone model beyond it walks alone
    secants: int = 12  # for what stands beside the hysteresis, at most
    # Window: nodes and what a plan costs (tracking table).
    node_s: float = 1e-3  # longest spacing of nodes, for loops that are faster
    smooth: float = 0.7  # weight of the second difference at 1 ms nodes, times slope^2
    least_smooth: float = 0.01  # of that weight, where nodes are further apart: no plan zigzags
    stiff_end: float = 400.0  # the terminal cost: smoothness grows by
    stiff_power: int = 6  # 1 + stiff_end (j / P)^stiff_power
    spring: float = 300.0  # stiffness beyond drive range and rate, times slope^2
    # Sweeps (tracking table, speed).
    sweeps: int = 2  # a node
    first_sweeps: int = 8  # for a plan that starts from nothing
    worth: float = 0.03  # of the cost, or of the noise's: a sweep that gains less is the last
    most_damping: float = 7.0  # times slope^2
    # Fallback: plan against static inverse within the window (random models).
    allowance: float = 0.25  # part of the noise that a plan in use may be worse by, rms
    gain: float = 0.7  # part of the static error that a plan must promise to be taken up
    looks: int = 4  # places along the window where they are compared
    clear: float = 1.5  # noises of static error, beyond which a good plan needs no comparison
    gone: float = 1e-5  # of the drive range: a gap that is over
    lost: float = 2.0  # times the static error: a plan beyond it begins again from there
    # Continuation of targets without look-ahead (tracking table, causal).
    causal_window_s: float = 0.1
    slope_fades_s: float = 0.06
    bend_fades_s: float = 0.02
    trust_fades_s: float = 0.04
    seen_margin: float = 0.25  # of the range of the targets so far, by which it may be left
    # Whole trajectory (tracking table).
    whole_smooth: float = 0.01  # as `smooth`
    whole_sweeps: int = 150
    refinements: int = 60
    settled: float = 1e-6  # relative gain of a round below which nothing more is tried
    refined_samples: int = 200_000  # longer trajectories are not refined
    arrived: float = 3.0  # times the noise: within this of the target for the first time
    settles_s: float = 0.02  # after the first arrival, until the approach is taken to be over


TUNING = Tuning()
