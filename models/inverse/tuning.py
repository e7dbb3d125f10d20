"""The inverse's constants, in one place.

Set by `python -m tests.benchmarks.models.inverse`: the tracking table on Eq. 12 (window), and its
random models (fallback). Lengths of time are in seconds, lags in samples; "slope" is the mean
|dy/du| over the range, "noise" the model's.
"""

from typing import NamedTuple


class Tuning(NamedTuple):
    """One frozen set; the kernels read it as constants."""

    # Window: nodes and what a plan costs (tracking table).
    node_s: float = 1e-3  # longest spacing of nodes, for loops that are faster
    smooth: float = 0.7  # weight of the second difference at 1 ms nodes, times slope^2
    least_smooth: float = 0.01  # of that weight, where nodes are further apart: no plan zigzags
    stiff_end: float = 400.0  # the terminal cost: smoothness grows by 1 + stiff_end (j / P)^6
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
    lost: float = 2.0  # times the static error: a plan beyond it begins again from there
    # Continuation of targets without look-ahead (tracking table, causal).
    slope_fades_s: float = 0.06
    bend_fades_s: float = 0.02
    trust_fades_s: float = 0.04
    seen_margin: float = 0.25  # of the range of the targets so far, by which it may be left
    # Whole trajectory (tracking table).
    whole_smooth: float = 0.01  # as `smooth`
    whole_sweeps: int = 150
    refinements: int = 60
    settled: float = 1e-6  # relative gain of a round below which nothing more is tried
    settles_s: float = 0.02  # after the first arrival, until the approach is taken to be over


TUNING = Tuning()
