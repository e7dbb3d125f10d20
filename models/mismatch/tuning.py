"""The constants of the mismatch monitor, judged by tests/benchmarks/models/mismatch.py: no false
flag in days of a stage in order, and a flag within seconds for what adds twice the noise."""

import math
from typing import NamedTuple


class Tuning(NamedTuple):
    """Times in seconds, motion in ranges, figures relative to their expected value."""

    # the judgement, made once a second
    window_s: int = 8
    shortest_s: int = 3  # window in which a large misfit is seen
    delay_s: int = 12  # newer figures do not raise their own threshold
    learn_s: int = 400  # of motion, before the first flag
    settled_s: int = 100  # of motion, before thresholds are learned
    early_s: int = 1000  # of motion, in which the baseline learns, slowly, even during a mismatch
    motion: float = 0.002  # rms motion that counts as motion
    moved_s: int = 10  # how long it counts afterwards
    block_s: int = 20  # of motion
    blocks: int = 180
    return_blocks: float = 2e3  # blocks of motion, half a day
    few: float = 4.0  # blocks: the fewer were seen, the higher the threshold
    least_spread: float = 0.05  # quartile distance over the median
    margin: float = 1.3  # times the largest figure so far
    clear: float = 0.9
    sudden: float = 2.0  # thresholds that the newest seconds must exceed
    fit: float = 40.0
    farther: float = 0.01  # ranges of the drive beyond its earlier range: `fit` starts again
    prior: float = 0.1  # of the model's misfit: prior variance of each feature
    stuck_s: float = 1.0  # of the same reading
    stuck_move: float = 10.0  # in noises, by which the model moved in the meantime
    # the arithmetic, sample by sample
    zero_s: float = 120.0  # how fast the baseline tracks a drifting zero; the rest is averaged
    beyond: float = 300.0  # noises per range: zero shift where the drive exceeds its earlier range
    together_s: float = 0.02  # correlation time of the misfit, which counts as one sample
    smooth_s: float = 0.1  # slower changes are not ringing
    trust_s: float = 0.3  # of a class of motion; before, the model's own figures are used
    floor_s: float = 300.0  # memory of a class's floor
    first_floor_s: float = 5.0  # the same while the baseline converges
    largest: float = 25.0  # cap on one sample, five standard deviations
    slow_hz: float = 500.0  # highest rate of the filter
    fast_hz: float = 2000.0  # highest rate of the short-lag differences
    speed_held_s: float = 0.1  # how long a speed and a change of speed determine the class
    jerk_held_s: float = 0.05
    steps: int = 4  # newest steps of the drive: lateness and ringing
    slopes: int = 2  # of these also times position: a volt moves the stage further mid-range


TUNING = Tuning()

# Least threshold of each figure. In order, `whole`, `ringing` and `short` are about 1; an effect of
# twice the noise adds 4 to `all`.
LEAST = {"gain": 0.7, "offset": 2.1, "whole": 1.6, "all": 2.5, "ringing": 1.6, "short": 1.9}
QUARTILES = math.log(math.log(4.0) / math.log(4.0 / 3.0))  # their distance in a Gumbel distribution
