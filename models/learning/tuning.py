"""The constants of learning from pass to pass."""

from typing import NamedTuple


class Tuning(NamedTuple):
    """One set, found with `python -m tests.benchmarks.daemon.learning`: sines, raster, staircase,
    faults."""

    gain: float = 0.8  # of the first two passes
    falls: float = 0.35  # a_k = gain / (1 + falls (k - 2)),
    least_gain: float = 0.08  # not below this, so that slow changes are followed
    mean_gain: float = 0.7  # for the mean, which needs no average over passes
    fade_s: float = 0.1  # from one correction to the next
    subtract: float = 3.0  # c, of a complex line
    subtract_real: float = 5.0  # c, of a real line, whose power scatters more
    noise_width: int = 25  # lines over which the noise's spectrum is averaged, at least
    noise_memory: float = 0.5  # weight of earlier passes in its average
    least_noise: float = 0.5  # of the model's noise power
    contracts: float = 0.9
    seen: float = 10.0  # noise powers by which a correction must change for P to be estimated
    follows: float = 0.5  # largest deviation from 1 of a right gauge's factor (error/correction);
    follows_explained: float = 0.25  # the same where that factor explains the first error,
    explained: float = 0.125  # and leaves less than this part of its power: with a right gauge, a
    # stage whose hysteresis the model lacks leaves 0.16 or more, a gauge of half the scale 0.02
    strange_passes: int = 2  # this many in a row contradict it before learning is undone
    grown: float = 1.25  # times the best error, twice in a row,
    grown_at_once: float = 2.5  # or once by this factor,
    grown_noises: float = 5.0  # and by this many standard deviations of the noise's power
    taken_up: float = 0.1  # rest of an abandoned correction below which passes count again
    least_factor: float = 1.0 / 16.0  # the gain is halved down to this
    missing: float = 0.005  # share of a pass that may be without a reading (or one sample)
    longest_gap: int = 3  # samples
    knock_noises: float = 8.0  # of the smoothed change from pass to pass
    knock_smooth: int = 5  # samples
    knock_share: float = 0.5  # of the known error, in the first passes
    same: float = 0.5  # two passes that differ by less than this part of their change agree
    band_grown: float = 1.5  # growth of its power at which a band is abandoned
    settling: int = 2  # number of first passes that may still settle,
    seam: int = 16  # samples at both ends over which this is judged, at least
    seam_noises: float = 5.0
    late_back: int = 10  # number of output steps whose ringing a late gauge may show
    late_passes: int = 4  # number of passes from which on it is computed
    late_noises: float = 4.0  # multiple of its noise power that is subtracted
    late_usual: float = 5.0  # times the median deviation of the times: a larger one is not used
    late_condition: float = 1e6
    closed: float = 3.0  # typical steps within which a pass ends where it began


TUNING = Tuning()
