"""The constants of identification, judged by tests/benchmarks/models/identify.py: rows and outliers
by its part `faults`, all others by `accuracy`, `real` and `speed`."""

from typing import NamedTuple


class Tuning(NamedTuple):
    """Lengths in shares of the drive's span, slopes in shares of the mean slope, but where said."""

    # rows: what of a recording may stand as an equation
    fewest_rows: int = 60
    long_gap: float = 5.5  # periods; over a longer gap the drive may have turned unseen
    near_zero: float = 0.01  # still counts as de-energised
    steadier: float = 0.7  # the drive must be this much smoother by number than by time stamp
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
    least_saturation: float = 0.05  # of the mean slope of the saturation
    narrow: float = 0.02  # narrower operators may at first run the wrong way
    spread: float = 0.1  # how much neighbouring slopes of wide operators differ
    nearby: float = 0.05  # the way that tells the direction at the start
    # structure
    tolerance: float = 0.005  # of the held-out power: less is not worth a larger model
    first_grid: int = 32
    finest_grid: int = 48
    roughly: float = 1e-4  # relative fall of the misfit at which a comparison is good enough
    parts: int = 5  # in time, of which some are held out
    held: tuple[int, ...] = (1, 4)
    few_cycles: float = 6.0  # with fewer, short_parts times as many parts
    short_parts: int = 5
    pull_weight: float = 0.8  # of the comparison drive, against all rows
    pull_price: float = 1.06  # held-out rms that the pull may cost, against the plain bounded fit
    least_explained: float = 0.5  # of the displacement's power, held out: else it does not follow
    start_factor: float = 2.0  # rms at the start over the rest, that the assumed start may leave
    start_share: float = 0.01  # of the displacement's range that it may leave anyway
    # sizes
    rows_compared: int = 12_000  # for the choice of the structure
    rows_slope: int = 1_000_000  # for the mean slope
    rows_finest: int = 100_000  # for the fit without bounds
    rows_fitted: int = 1_000_000  # for the last fit: more do not lower its error by a nanometre
    most_held: int = 30_000_000  # numbers in the equations of the last fit
    stretches: int = 50  # of time, for the intervals


TUNING = Tuning()
