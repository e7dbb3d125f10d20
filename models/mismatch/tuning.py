"""The constants of the mismatch monitor, judged by tests/benchmarks/models/mismatch.py: no false
flag in days of a stage in order, and a flag within seconds for what adds twice the noise."""

import math
from typing import NamedTuple


class Tuning(NamedTuple):
    """Times in seconds, motion in ranges, figures in shares of what is expected."""

    # the judgement, once a second
    window_s: int = 8
    shortest_s: int = 3  # a large misfit is seen in so many seconds
    delay_s: int = 12  # what is newer than this does not lift its own threshold
    learn_s: int = 400  # of motion, before the first flag
    settled_s: int = 100  # of motion, before scatter is learned
    early_s: int = 1000  # of motion: so long the baseline learns, slowly, even under a flag
    motion: float = 0.002  # rms motion that counts
    moved_s: int = 10  # and for how long it does
    block_s: int = 20  # of motion
    blocks: int = 180
    return_blocks: float = 2e3  # blocks of motion, half a day
    few: float = 4.0  # blocks: the fewer were seen, the wider the threshold
    least_spread: float = 0.05  # of the quartiles, over the median
    margin: float = 1.3  # times the largest
    clear: float = 0.9
    sudden: float = 2.0  # thresholds that the newest seconds must exceed
    fit: float = 40.0
    farther: float = 0.01  # ranges of the drive: so far beyond where it was, `fit` begins anew
    prior: float = 0.1  # of the model's misfit: variance that each feature may explain
    stuck_s: float = 1.0  # the same reading so long
    stuck_move: float = 10.0  # while the model moved by so many noises
    # the arithmetic, sample by sample
    zero_s: float = 120.0  # how fast the baseline follows a drifting zero; the rest is averaged
    beyond: float = 300.0  # noises per range: so much the zero may shift where no drive has been
    together_s: float = 0.02  # misfit hangs together in time: so long says as much as one sample
    smooth_s: float = 0.1  # slower than this is not ringing
    trust_s: float = 0.3  # of a class of motion: before, the model's own figures count
    floor_s: float = 300.0  # memory of a class' floor
    first_floor_s: float = 5.0  # and while the baseline is found
    largest: float = 25.0  # one sample counts for no more than five standard deviations
    slow_hz: float = 500.0  # highest rate of the filter
    fast_hz: float = 2000.0  # and of the short-lag differences
    speed_held_s: float = 0.1  # for how long a speed and a change of speed tell the class
    jerk_held_s: float = 0.05
    steps: int = 4  # newest steps of the drive: what is late, and what rings
    slopes: int = 2  # of them also times the position: a volt moves the stage further in the middle


TUNING = Tuning()

# Figure: its least threshold. In order `whole`, `ringing` and `short` are about 1; what adds twice
# the noise adds 4 to `all`.
LEAST = {"gain": 0.7, "offset": 2.1, "whole": 1.6, "all": 2.5, "ringing": 1.6, "short": 1.9}
QUARTILES = math.log(math.log(4.0) / math.log(4.0 / 3.0))  # their distance in a Gumbel distribution
