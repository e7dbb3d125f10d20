"""The constants of learning from pass to pass."""

from typing import NamedTuple


class Tuning(NamedTuple):
    """Set by `python -m tests.benchmarks.daemon.learning`: sines, raster, staircase, faults."""

    gain: float = 0.8  # of the first two passes
    falls: float = 0.35  # a_k = gain / (1 + falls (k - 2)),
    least_gain: float = 0.08  # not below this: what changes slowly is followed
    mean_gain: float = 0.7  # of the mean, which needs no average over passes
    fade_s: float = 0.1  # from one correction to the next
    subtract: float = 3.0  # c, of a complex line
    subtract_real: float = 5.0  # of a real one, whose power scatters more
    noise_width: int = 25  # lines over which the noise's spectrum is averaged, at the least
    noise_memory: float = 0.5  # of its average over passes
    least_noise: float = 0.5  # of the model's noise power
    contracts: float = 0.9
    seen: float = 10.0  # noise powers by which a correction must change for P to be reported
    follows: float = 0.5  # from 1: factor between error and correction of a gauge that is right;
    follows_explained: float = 0.25  # the same where that factor accounts for the first error,
    explained: float = 0.125  # of whose power it then leaves less: with a right gauge, a stage of
    # which the model knows no hysteresis leaves 0.16 and more, a gauge of half the scale 0.02
    strange_passes: int = 2  # so many in a row contradict it, before all is taken back
    grown: float = 1.25  # times the best error, twice in a row,
    grown_at_once: float = 2.5  # or once by so much,
    grown_noises: float = 5.0  # and by so many standard deviations of the noise's power
    taken_up: float = 0.1  # what is left of a correction that was given up, before it counts again
    least_factor: float = 1.0 / 16.0  # the gain is halved down to this
    missing: float = 0.005  # share of a pass that may be without a reading (or one sample)
    longest_gap: int = 3  # samples
    knock_noises: float = 8.0  # of the smoothed change from pass to pass
    knock_smooth: int = 5  # samples
    knock_share: float = 0.5  # of the error that is known, in the first passes
    same: float = 0.5  # two passes that differ by less than this part of their change agree
    band_grown: float = 1.5  # times its power, where a band is given up
    settling: int = 2  # first passes that may still settle,
    seam: int = 16  # judged over so many samples at both ends, at the least
    seam_noises: float = 5.0
    late_back: int = 10  # steps of the output whose ringing a late gauge may show
    late_passes: int = 4  # from which on it is computed
    late_noises: float = 4.0  # its noise power, of which so much is taken off
    late_usual: float = 5.0  # of the median of what the times are off by: a longer one is none
    late_condition: float = 1e6
    closed: float = 3.0  # a pass ends where it began: within so many of its typical steps


TUNING = Tuning()
