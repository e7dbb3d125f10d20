"""Learn the repeating error from pass to pass (iterative learning control).

A trajectory is played repeatedly. The error of pass k is e_k = d + P u_k + noise, with u_k the
correction of the targets in force, d the error that repeats in each pass, and P close to 1, because
the inverse compensates the stage's dynamics. So D_k = e_k - u_k is an observation of d, and

    d_k = d_(k-1) + a_k (D_k - d_(k-1)),      u_(k+1) = -W_k d_k,

which is u_(k+1) = u_k - a_k e_k where W = 1. The gain a_k is below one and falls from pass to pass:
the average over passes reduces the noise (Saab, IEEE Trans. Autom. Control 46, 2001; Bristow,
Tharayil & Alleyne, IEEE Control Syst. Mag. 26, 2006: the survey). The first pass starts from
another position and is not learned from. W_k acts on the spectrum of the whole pass and is real, so
it is zero-phase. Per frequency,

    W = 1 - c v N / |d|^2, not below 0,

with N the noise's spectrum and v N the noise that remains in the average (spectral subtraction:
Boll, IEEE Trans. ASSP 27, 1979). N comes from the model's noise and from the differences between
passes, so the filter passes the frequencies at which the repeating error exceeds the noise, without
tuning. A pass that ends where it began is treated as periodic; any other is mirrored at its ends
(cosine transform), so that its edges do not ring.

Contraction is checked where the correction has changed by enough: P is estimated in each third of
an octave, by regression of the error's change on the correction's change. Where |1 - a P| is not
below `contracts` and the error grows, that band is no longer learned. When the error of whole
passes has grown, the best correction is restored and the gain is halved. Where the error of the
whole pass follows the correction by a factor far from 1 (a gauge of the wrong sign, scale or
delay), the measured error may fall while the true one grows: the initial correction is restored and
learning stops (models/learning/following.py).
"""

import math
from dataclasses import dataclass
from typing import Any

import numpy as np
import scipy.fft
from numpy.typing import NDArray

from dehyst.models.errors import BadInput
from dehyst.models.learning.following import FollowingCheck, Spectrum, power_of
from dehyst.models.learning.tuning import TUNING
from dehyst.models.model import Floats


@dataclass(frozen=True)
class Pass:
    """One pass from telemetry, arrays (n,). error: measured minus target, NaN: no fresh reading;
    used: correction in force; trimmed: the slow trim is active and handles the mean; its motion
    within a pass repeats with the rest. error_redefined: from this pass on the error is computed
    differently, and must not be compared with earlier passes."""

    error: Floats
    used: Floats
    trimmed: bool = False
    error_redefined: bool = False


@dataclass(frozen=True)
class Outcome:
    """Result of a pass. rms: of the error without the noise; mean: of the error; learned: whether
    the pass was learned from; says: why not, or another message, or ""; width_hz: the highest
    frequency that is learned now; gain: a_k of the next pass."""

    number: int
    rms: float
    mean: float
    learned: bool
    says: str
    width_hz: float
    gain: float


class Learner:
    """Learn the correction of one trajectory.

    target: (n,) one pass, one point per period; period_s: sampling period; noise: standard
    deviation of a reading; bound: largest correction; correction: (n,) one to start from.
    `correction`: (n,) for the next pass. Raises BadInput on bad arguments.
    """

    def __init__(
        self,
        target: Floats,
        period_s: float,
        noise: float,
        bound: float,
        correction: Floats | None = None,
    ) -> None:
        target = np.asarray(target, np.float64)
        if target.ndim != 1 or target.size < 16 or not np.isfinite(target).all():
            raise BadInput("a pass that is learned needs 16 or more finite targets")
        if not (period_s > 0.0 and noise > 0.0 and bound > 0.0):
            raise BadInput("period, noise and bound of the learning must be positive")
        self.period_s, self.noise, self.bound = period_s, noise, bound
        self.n = n = target.size
        steps = np.abs(np.diff(target))
        typical = float(np.quantile(steps, 0.9)) + noise  # not the median: a staircase mostly rests
        self.closed = abs(target[0] - target[-1]) <= TUNING.closed * typical
        lines = n // 2 + 1 if self.closed else n
        self.hertz = np.arange(lines) / (n * period_s * (1.0 if self.closed else 2.0))
        self.passes = self.learned = 0
        self.outcomes: list[Outcome] = []
        kind: Any = np.complex128 if self.closed else np.float64
        self._repeats: Any = np.zeros(lines, kind)
        self._known = correction is not None
        self.correction = np.zeros(n)
        if correction is not None:
            self.correction = self._bounded(np.asarray(correction, np.float64))
            self._repeats = -self._spectrum(self.correction)
        self._left = 0.0 if correction is not None else 1.0  # v
        self._noise_power = np.full(lines, noise**2)
        self._factor = 1.0
        self._bands = _thirds(self.hertz)
        self._off = np.zeros(len(self._bands), np.bool_)
        self._before: tuple[Spectrum, Spectrum] | None = None  # error, correction
        self._doubted: Floats | None = None
        self._best: tuple[float, Spectrum] | None = None
        self._grown = 0
        self._given_up: Spectrum | None = None
        self._following = FollowingCheck(self._spectrum(target))
        self._stopped = ""  # why nothing is learned any more

    # -- one pass ---------------------------------------------------------------------------------

    def take(self, one: Pass) -> Outcome:
        """Learn from a pass, or report why not."""
        self.passes += 1
        valid = np.isfinite(one.error)
        known = one.error[valid]
        mean = float(known.mean()) if known.size else math.nan
        spread = float(known.std()) if known.size else math.nan
        rms = math.sqrt(max(spread**2 - self.noise**2, 0.0)) if known.size else math.nan
        wrong = self._stopped or _describe_missing(valid)
        error = _interpolate_missing(one.error) if not wrong else one.error
        repeats = error - one.used
        if not wrong and one.trimmed:
            repeats = repeats - repeats.mean()
        if one.error_redefined:
            self._forget_errors()
        elif not wrong:
            wrong = self._find_settling(repeats) or self._find_knock(repeats)
        if wrong:
            return self._make_outcome(rms, mean, False, f"not used for learning: {wrong}")
        if self._does_not_follow(self._spectrum(error), self._spectrum(one.used)):
            return self._make_outcome(rms, mean, False, f"not used for learning: {self._stopped}")
        says = self._learn(error, one.used, repeats)
        return self._make_outcome(rms, mean, True, says)

    def _make_outcome(self, rms: float, mean: float, learned: bool, says: str) -> Outcome:
        width = float(self.hertz[np.flatnonzero(self.weights > 0.0)].max(initial=0.0))
        out = Outcome(self.passes, rms, mean, learned, says, width, self.gain)
        self.outcomes.append(out)
        return out

    @property
    def gain(self) -> float:
        """Return a_k of the next pass that is learned from."""
        falling = TUNING.gain / (1.0 + TUNING.falls * max(0, self.learned - 1))
        return self._factor * max(falling, TUNING.least_gain)

    @property
    def weights(self) -> Floats:
        """Return (lines,) W."""
        power = np.abs(self._repeats) ** 2
        c = TUNING.subtract if self.closed else TUNING.subtract_real
        out = np.maximum(1.0 - c * self._left * self._noise_power / np.maximum(power, 1e-300), 0.0)
        out[0] = 1.0
        for band, off in zip(self._bands, self._off, strict=True):
            if off:
                out[band] = 0.0
        return out

    def _learn(self, error: Floats, used: Floats, repeats: Floats) -> str:
        e, u, d = (self._spectrum(x) for x in (error, used, repeats))
        said = [self._stop_unresponsive_bands(e, u)]
        self._before = e, u
        back = self._restore_if_grown(e, u)
        if back:
            said.append(back)
        else:
            if self.learned > 1 or self._known:
                self._update_noise(d - self._repeats)
            a = self.gain
            mean = self._repeats[0] + TUNING.mean_gain * (d[0] - self._repeats[0])
            self._repeats = self._repeats + a * (d - self._repeats)
            self._repeats[0] = mean
            self._left = (1.0 - a) ** 2 * self._left * (self.learned > 0 or self._known) + a * a
            self.learned += 1
        self.correction = self._bounded(self._back(-self.weights * self._repeats))
        return "; ".join(text for text in said if text)

    def _update_noise(self, change: Spectrum) -> None:
        """Update the noise's spectrum from the difference of a pass to the earlier average."""
        power = np.abs(change) ** 2 / (1.0 + self._left)
        width = max(TUNING.noise_width, power.size // 200)  # lines; of many, half a per cent
        seen = _running_mean(power, width)
        mixed = self._noise_power + (1.0 - TUNING.noise_memory) * (seen - self._noise_power)
        self._noise_power = np.maximum(mixed, TUNING.least_noise * self.noise**2)

    def _stop_unresponsive_bands(self, e: Spectrum, u: Spectrum) -> str:
        """Stop learning the bands in which the error does not follow the correction."""
        if self._before is None or self.learned < 2:
            return ""
        de, du = e - self._before[0], u - self._before[1]
        stopped = []
        for i, band in enumerate(self._bands):
            power = float(np.sum(np.abs(du[band]) ** 2))
            if self._off[i] or power < TUNING.seen * float(np.sum(self._noise_power[band])):
                continue
            p = complex(np.vdot(du[band], de[band])) / power
            now, then = (float(np.sum(np.abs(x[band]) ** 2)) for x in (e, self._before[0]))
            grown = now > TUNING.band_grown * then
            if grown and abs(1.0 - TUNING.gain * self._factor * p) >= TUNING.contracts:
                self._off[i] = True
                stopped.append(f"{self.hertz[band][0]:.3g} to {self.hertz[band][-1]:.3g} Hz")
        if not stopped:
            return ""
        return f"learning stopped at {', '.join(stopped)}: the error does not respond there"

    def _does_not_follow(self, e: Spectrum, u: Spectrum) -> bool:
        """Restore the initial correction and stop where the pass' error does not follow it."""
        wrong = self._following.find_fault(e, u, self._noise_power)
        if not wrong or self._following.first is None:
            return False
        self._repeats = -self._following.first[1]
        self.correction = self._bounded(self._back(self._following.first[1]))
        self._stopped = f"{wrong}; the initial correction is restored"
        return True

    def _restore_if_grown(self, e: Spectrum, u: Spectrum) -> str:
        """Restore the best correction where the error has grown."""
        figure = max(self._error_power(e), 0.0)
        if self._given_up is not None:  # the old correction may still be played
            there = -self._repeats
            if power_of(u - there) > TUNING.taken_up * power_of(self._given_up - there):
                return ""
            self._given_up = None
        if self._best is None or figure < self._best[0]:
            self._best, self._grown = (figure, u), 0
            return ""
        more = TUNING.grown_noises * self.noise**2 * math.sqrt(2.0 / self.n)
        at_once = figure > TUNING.grown_at_once**2 * self._best[0] + more
        if not (at_once or figure > TUNING.grown**2 * self._best[0] + more):
            self._grown = 0
            return ""
        self._grown += 1
        if (self._grown < 2 and not at_once) or power_of(u - self._best[1]) == 0.0:
            return ""
        self._repeats, self._given_up = -self._best[1], u
        self._factor = max(0.5 * self._factor, TUNING.least_factor)
        self._best, self._grown = None, 0
        return "the error has grown: back to the best correction, with half the gain"

    def _error_power(self, e: Spectrum) -> float:
        """Return the mean square of a pass' error about its mean, minus the noise power."""
        twice = 2.0 if self.closed else 1.0
        return twice * float(np.sum(np.abs(e[1:]) ** 2 - self.noise**2)) / self.n

    def _find_settling(self, repeats: Floats) -> str:
        """Return a message where an early pass still settles, else "". In a settled closed pass the
        repeating error is the same at the end as at the beginning."""
        if self._known or self.passes > TUNING.settling:
            return ""
        if self.passes == 1:
            return "the first pass starts from another position"
        if not self.closed:
            return ""
        m = min(max(TUNING.seam, self.n // 50), self.n // 2)  # 2 % of a pass
        places = np.arange(m) + 0.5  # a straight line on each side of the seam at 0
        after = float(np.polyval(np.polyfit(places, repeats[:m], 1), 0.0))
        before = float(np.polyval(np.polyfit(-places[::-1], repeats[-m:], 1), 0.0))
        apart = before - after
        if abs(apart) <= TUNING.seam_noises * self.noise * math.sqrt(8.0 / m):
            return ""
        return f"the stage is still settling, by {apart:+.3g} from start to end of the pass"

    def _find_knock(self, repeats: Floats) -> str:
        """Return a message where a pass differs from earlier ones at one place far more than
        elsewhere, else ""."""
        if not (self.learned or self._known):
            return ""
        known = self._back(self._repeats)
        change = repeats - known
        smooth = _running_mean(change - np.median(change), TUNING.knock_smooth)
        scatter = 1.4826 * float(np.median(np.abs(smooth - np.median(smooth))))
        few = TUNING.knock_share / max(1, self.learned)
        allowed = TUNING.knock_noises * max(scatter, self.noise / math.sqrt(TUNING.knock_smooth))
        allowed += few * float(np.abs(known - known.mean()).max())
        at = int(np.argmax(np.abs(smooth)))
        if abs(smooth[at]) <= allowed:
            self._doubted = None
            return ""
        doubted, self._doubted = self._doubted, repeats
        if doubted is None:
            return f"a knock of {smooth[at]:+.3g} at {at * self.period_s:.3f} s"
        again = _running_mean(repeats - doubted, TUNING.knock_smooth)
        if np.abs(again - np.median(again)).max() < TUNING.same * abs(smooth[at]):
            self._forget_errors()  # twice the same: the stage has changed, it was no knock
            return ""
        return f"a knock of {smooth[at]:+.3g} at {at * self.period_s:.3f} s"

    def _forget_errors(self) -> None:
        """Discard the errors of earlier passes; keep the estimate of the repeating error."""
        self.learned, self._best, self._grown = min(self.learned, 1), None, 0
        self._before = self._doubted = None
        self._following.forget_errors()

    # -- spectrum ---------------------------------------------------------------------------------

    def _spectrum(self, x: Floats) -> Spectrum:
        if self.closed:
            out: Spectrum = scipy.fft.rfft(x, norm="ortho")
        else:
            out = scipy.fft.dct(x, norm="ortho")
        return out

    def _back(self, x: Spectrum) -> Floats:
        if self.closed:
            return np.asarray(scipy.fft.irfft(x, self.n, norm="ortho"), np.float64)
        return np.asarray(scipy.fft.idct(x, norm="ortho"), np.float64)

    def _bounded(self, x: Floats) -> Floats:
        """Scale x down to the bound as a whole, so that its shape is kept."""
        most = float(np.abs(x).max())
        return x if most <= self.bound else x * (self.bound / most)


def _thirds(hertz: Floats) -> list[slice]:
    """Return bands of a third of an octave, each of four lines or more."""
    bands, first = [], 1
    while first < hertz.size:
        last = max(first + 4, int(np.searchsorted(hertz, hertz[first] * 2.0 ** (1.0 / 3.0))))
        bands.append(slice(first, min(last, hertz.size)))
        first = last
    return bands


def fade_share(samples: NDArray[np.int64], over: int) -> Floats:
    """Return (n,) the share of the new correction, `samples` after its beginning: it rises from 0
    to 1 over `over` samples, without a step in value or slope."""
    share = np.clip((samples + 1.0) / max(1, over), 0.0, 1.0)
    return np.asarray(share * share * (3.0 - 2.0 * share), np.float64)


def _describe_missing(valid: NDArray[np.bool_]) -> str:
    """Return a message where too much of a pass has no reading, else ""."""
    lost = int(np.count_nonzero(~valid))
    if not lost:
        return ""
    edges = np.flatnonzero(np.diff(np.concatenate([[True], valid, [True]]).astype(np.int8)))
    longest = int(np.max(edges[1::2] - edges[::2]))
    if lost <= max(1.0, TUNING.missing * valid.size) and longest <= TUNING.longest_gap:
        return ""
    return f"{lost} of {valid.size} samples are missing or without a reading"


def _interpolate_missing(x: Floats) -> Floats:
    """Fill missing samples by linear interpolation."""
    good = np.isfinite(x)
    if good.all():
        return x
    places = np.arange(x.size)
    return np.asarray(np.interp(places, places[good], x[good]), np.float64)


def _running_mean(x: Floats, width: int) -> Floats:
    """Return (n,) means over `width` neighbours, fewer at the ends."""
    width = min(width, x.size)
    total = np.cumsum(np.concatenate([[0.0], x]))
    first = np.maximum(np.arange(x.size) - width // 2, 0)
    last = np.minimum(first + width, x.size)
    return np.asarray((total[last] - total[first]) / (last - first), np.float64)
