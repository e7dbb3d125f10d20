"""The mismatch watch: does the stage still behave as its model? Drives and readings in, health out.

A model never fits quite: creep that it does not have, hysteresis between its thresholds, a bridge
that warms up. That part of the misfit repeats itself, and the watch learns it while it looks: the
residual (measured - predicted) is explained by a linear baseline

    e_k = w' phi_k + noise
    phi = (1, p, p^2, newest steps of x, p times them, x - play_r(x), p (x - play_r(x)),
           and what is left of p, p^2 and x when lowpass_tau is taken off)

with x the drive and p the predicted displacement, both as shares of their range. The weights w
are followed by a Kalman filter that forgets slowly (West & Harrison, Bayesian Forecasting and
Dynamic Models, ch. 4). What is left over is judged over the last WINDOW_S, in units of the noise
that the model states, against floors that are learned for each class of motion:

    gain      power along the displacement and along what creep makes of it
    offset    square of the mean: drift, a shifted zero
    whole     all power but the mean's
    ringing   power of what changes within SMOOTH_S: resonance, hum
    short     power of differences over half a millisecond: noise, fast ringing
    fit       power of the residual itself, without baseline, over what the model states

Each has a threshold, a multiple of the most that was seen so far in order, so that a run to which
the model fits less well is not reported for that; it is wider in the first minutes, and the
multiple falls with the time that was seen. health is
the largest figure over its threshold: below 1 in order, above 1 `mismatch`, until all are below
CLEAR again. Nothing is learned while it is raised. Pure: no clock, no files.
"""

import math
from collections import deque

import numpy as np

from dehyst.models import watch_kernel as k
from dehyst.models.forward import simulate
from dehyst.models.model import Floats, Model
from dehyst.models.recording import Bools

WINDOW_S = 8
SHORTEST_S = 3  # a large misfit is seen in so many seconds
DELAY_S = 12  # what is newer than this does not lift its own threshold
FORGET_S = 7200.0
FIRST_S, WIDE_S = 20.0, 200.0  # how fast the thresholds of the beginning narrow
SURE_S, SURE = 6000.0, 1.3  # the longer the most was seen, the less is it multiplied: down to this
CLEAR = 0.6
# (least of all, share of the most seen in order, least at the beginning)
LEVELS = {
    "gain": (0.3, 2.5, 2.0),
    "offset": (0.6, 3.0, 5.0),
    "whole": (0.0, 1.9, 3.0),
    "ringing": (0.0, 1.8, 2.2),
    "short": (0.0, 1.9, 2.2),
    "fit": (40.0, 0.0, 0.0),
}
STUCK_S, STUCK_MOVE = 1.0, 10.0  # the same reading so long while the model moved by so many noises


class _Level:
    """Threshold of one figure: a multiple of the most seen, wider at the beginning."""

    def __init__(self, least: float, margin: float, wide: float, first: float) -> None:
        self.least, self.margin, self.wide, self.first = least, margin, wide, first
        self.most = 0.0
        self.seen_s = 0.0
        self.waiting: deque[float] = deque()

    @property
    def threshold(self) -> float:
        first = self.first * math.exp(-self.seen_s / FIRST_S)
        wide = self.wide * math.exp(-self.seen_s / WIDE_S)
        margin = SURE + (self.margin - SURE) * math.exp(-self.seen_s / SURE_S)
        return min(max(self.least + margin * self.most, wide) + first, self.first)

    def see(self, figure: float, raised: bool) -> None:
        """One second's figure; it counts when it is old enough and nothing was raised since."""
        if raised:
            self.waiting.clear()
            return
        self.waiting.append(figure)
        if len(self.waiting) > DELAY_S:
            self.seen_s += 1.0
            self.most = max(self.most * math.exp(-1.0 / FORGET_S), self.waiting.popleft())


class Watch:
    """Watches one stage against one model.

    model: what the loop runs; period_s: the loop's period. Units are the model's.
    figures, thresholds: by name, of the newest second.
    """

    def __init__(self, model: Model, period_s: float) -> None:
        v = model.validity
        ends = simulate(model.hysteresis, np.array([v.drive_min, v.drive_max, v.drive_min]), 1e9)
        stroke = max(float(np.ptp(ends)), 1e-12)
        fit = model.fit
        self.noise = max(fit.noise_rms or fit.rms or 0.002 * stroke, 1e-5 * stroke)
        misfit = max(fit.holdout_rms or 0.0, fit.rms or 0.0, 2.0 * self.noise) / self.noise
        self.period_s = period_s
        self._scale = np.array(
            [v.drive_min, v.drive_max - v.drive_min, float(ends.min()), stroke, self.noise]
        )
        self._every = max(1, round(1.0 / (period_s * k.SLOW_HZ)))
        self._lag = max(1, round(1.0 / (period_s * k.FAST_HZ)))
        prior = np.full(k.N_FEATURES, misfit**2)
        prior[0] = (0.05 * stroke / self.noise) ** 2  # where the sensor's zero lies is free
        self._prior, self._w, self._cov = prior, np.zeros(k.N_FEATURES), np.diag(prior)
        self._z, self._low = np.zeros(k.PLAYS.size), np.zeros(k.N_LOW)
        self._steps = np.zeros(k.STEPS)
        self._floors = np.full((3, k.N_CLASSES), misfit**2)
        self._weights = np.full((3, k.N_CLASSES), 0.25)
        self._past = np.full(self._lag + 1, np.nan)
        self._now = np.zeros(k.N_NOW)
        self._now[k.LEARN] = 1.0
        self._block = np.zeros(k.N_BLOCK)
        self._phi, self._gain = np.zeros(k.N_FEATURES), np.zeros(k.N_FEATURES)
        self._blocks: deque[Floats] = deque(maxlen=WINDOW_S)
        self._misfit2 = misfit**2
        first = {"gain": 9.0 * misfit**2, "offset": 9.0 * misfit**2, "fit": 40.0}
        self._levels = {n: _Level(*numbers, first.get(n, 20.0)) for n, numbers in LEVELS.items()}
        self.figures: dict[str, float] = dict.fromkeys(LEVELS, 0.0)
        self.mismatch = False
        self.seconds = self._poor_s = 0

    def update(self, drive: Floats, predicted: Floats, measured: Floats, good: Bools) -> bool:
        """A batch of samples: (n,) drive in force at each reading [drive unit], what the model
        expected of the reading, the reading, and where that is a fresh valid one. True when a
        second was completed and judged."""
        drive = np.ascontiguousarray(drive, np.float64)
        predicted = np.ascontiguousarray(predicted, np.float64)
        measured = np.where(good, measured, np.nan)
        judged = False
        while drive.size:
            taken = k.run(
                drive, predicted, measured, self._scale, self._every, self._lag, self.period_s,
                self._prior, self._w, self._cov, self._z, self._low, self._steps, self._floors,
                self._weights, self._past, self._now, self._block, self._phi, self._gain,
            )  # fmt: skip
            drive, predicted, measured = drive[taken:], predicted[taken:], measured[taken:]
            if self._now[k.BLOCK_S] >= 1.0:
                self._judge()
                judged = True
        return judged

    @property
    def health(self) -> float:
        """Largest figure over its threshold: below 1 in order."""
        return float(max(self.figures[n] / lv.threshold for n, lv in self._levels.items()))

    @property
    def thresholds(self) -> dict[str, float]:
        """The figures' thresholds now."""
        return {name: level.threshold for name, level in self._levels.items()}

    @property
    def cause(self) -> str:
        """The figure that is largest over its threshold."""
        return max(LEVELS, key=lambda n: self.figures[n] / self._levels[n].threshold)

    @property
    def stuck_s(self) -> float:
        """Seconds for which the reading has been the same to the last digit although the model
        moved; 0: it is not stuck."""
        moved = (self._now[k.STILL_HIGH] - self._now[k.STILL_LOW]) * self._scale[3]
        still_s = float(self._now[k.STILL_S])
        return still_s if still_s >= STUCK_S and moved > STUCK_MOVE * self.noise else 0.0

    def _judge(self) -> None:
        self._blocks.append(self._block.copy())
        self._block[:] = 0.0
        self._now[k.BLOCK_S] -= 1.0
        self.seconds += 1
        blocks = list(self._blocks)
        long = _figures(blocks, self._misfit2)
        short = _figures(blocks[-SHORTEST_S:], self._misfit2)
        self.figures = long
        if len(blocks) < SHORTEST_S:
            return
        # a large misfit need not wait for the long window
        health = self.health
        sudden = max(short[n] / (3.0 * lv.threshold) for n, lv in self._levels.items())
        self._poor_s = self._poor_s + 1 if health > 1.0 else 0
        if self._poor_s >= 2 or sudden > 1.0:
            self.mismatch = True
        elif health < CLEAR and max(short[n] / lv.threshold for n, lv in self._levels.items()) < 1:
            self.mismatch = False
        for name, level in self._levels.items():
            level.see(long[name], self.mismatch)
        self._now[k.LEARN] = 0.0 if self.mismatch else 1.0 / (1.0 + max(0.0, 4.0 * health - 2.0))


def _figures(blocks: list[Floats], misfit2: float) -> dict[str, float]:
    """Figures of the sums of some seconds."""
    s = np.sum(blocks, axis=0)
    if s[k.B_N] < 1.0:
        return dict.fromkeys(LEVELS, 0.0)
    weight, mean = s[k.B_W], s[k.B_E] / s[k.B_W]
    ways = np.array([s[k.B_P], s[k.B_C]])
    square = np.array([[s[k.B_PP], s[k.B_PC]], [s[k.B_PC], s[k.B_CC]]])
    square -= np.outer(ways, ways) / weight
    along = np.array([s[k.B_PE], s[k.B_CE]]) - ways * mean
    explained = along @ np.linalg.pinv(square, rcond=1e-3, hermitian=True) @ along
    count = s[k.B_N]
    return {
        "gain": max(0.0, float(explained)) / count,
        "offset": float(mean**2) * weight / count,
        "whole": max(0.0, float(s[k.B_WHOLE] - mean**2 * weight) / count),
        "ringing": float(s[k.B_RINGING] / count),
        "short": float(s[k.B_SHORT] / max(s[k.B_NSHORT], 1.0)),
        "fit": float(s[k.B_RAW2] / count - (s[k.B_RAW] / count) ** 2) / misfit2,
    }
