"""The mismatch watch: does the stage still behave as its model? Drives and readings in, health out.

A model never fits quite: creep that it does not have, hysteresis between its thresholds, a bridge
that warms up. That part of the misfit repeats itself, and the watch learns it while it looks: the
residual (measured - predicted) is explained by a linear baseline

    e_k = w' phi_k + noise
    phi = (1, p, p^2, the part of p that comes from the model's own rate terms,
           newest steps of x, p times them, x - play_r(x), p (x - play_r(x)),
           and what is left of p, p^2 and x when lowpass_tau is taken off)

with x the drive and p the predicted displacement, both as shares of their range. The weights w
are followed by a Kalman filter that forgets slowly (West & Harrison, Bayesian Forecasting and
Dynamic Models, ch. 4). What is left over is judged over the last WINDOW_S, in units of the noise
that the model states, against floors that are learned for each class of motion:

    gain      power along the displacement and along what creep makes of it
    offset    square of the mean: drift, a shifted zero
    whole     all power but the mean's
    all       and with the mean's
    ringing   power of what changes within SMOOTH_S: resonance, hum
    short     power of differences over half a millisecond: noise, fast ringing
    fit       power of the residual itself, without baseline, over what the model states

For LEARN_S of motion (seconds in which the stage moves, or has just moved) it only learns; but for
a `fit` far out, nothing is reported. From then on each figure has a threshold: what it exceeds
once in RETURN blocks of BLOCK_S, from a Gumbel distribution through the quartiles of the blocks'
largest values in order (Coles, An Introduction to Statistical Modeling of Extreme Values, ch. 3),
and no less than MARGIN times the largest of all, nor than what is of interest; more while few
blocks were seen. health is the largest figure over its threshold: below 1 in order, above 1
`mismatch`, until all are below CLEAR again; below 0 while it still learns. No threshold learns
while it is raised, and after the first EARLY_S of motion the baseline does not either, but for its
zero. Where the drive has never been before, the zero may shift. Pure: no clock, no files.
"""

import math
from collections import deque

import numpy as np

from dehyst.models import watch_kernel as k
from dehyst.models.forward import initial_plays, simulate
from dehyst.models.model import Floats, Model
from dehyst.models.recording import Bools

WINDOW_S = 8
SHORTEST_S = 3  # a large misfit is seen in so many seconds
DELAY_S = 12  # what is newer than this does not lift its own threshold
LEARN_S, SETTLED_S = 400, 100  # of motion, before the first flag; before scatter is learned
EARLY_S = 1000  # of motion: so long the baseline learns, slowly, even while a flag is raised
MOTION, MOVED_S = 0.002, 10  # rms motion [ranges] that counts, and for how long it does
BLOCK_S, BLOCKS = 20, 180  # of motion
RETURN = 2e3  # blocks of motion, half a day
FEW = 4.0  # blocks: the fewer were seen, the wider the threshold
LEAST_SPREAD, MARGIN = 0.05, 1.3  # of the quartiles, over the median; times the largest
QUARTILES = math.log(math.log(4.0) / math.log(4.0 / 3.0))  # their distance in a Gumbel distribution
CLEAR = 0.9
SUDDEN = 2.0  # thresholds that the newest seconds must exceed
# figure: its least threshold. In order `whole`, `ringing` and `short` are about 1; what adds twice
# the noise adds 4 to `all`.
FIGURES = {"gain": 0.7, "offset": 2.1, "whole": 1.6, "all": 2.5, "ringing": 1.6, "short": 1.9}
FIT = 40.0
PRIOR = 0.1  # of the model's misfit: variance that each feature may explain
STUCK_S, STUCK_MOVE = 1.0, 10.0  # the same reading so long while the model moved by so many noises


class _Level:
    """Threshold of one figure: what it hardly ever exceeds while the stage is in order."""

    def __init__(self, least: float) -> None:
        self.least, self.threshold = least, math.inf
        self._largest: deque[float] = deque(maxlen=BLOCKS)  # of each block
        self._block: list[float] = []
        self._waiting: deque[float] = deque()

    def see(self, figure: float) -> None:
        """One second's figure in order; it counts when it is old enough."""
        self._waiting.append(figure)
        if len(self._waiting) <= DELAY_S:
            return
        self._block.append(self._waiting.popleft())
        if len(self._block) == BLOCK_S:
            self._largest.append(max(self._block))
            self._block = []
            self._learn()

    def _learn(self) -> None:
        found = np.array(self._largest)
        if found.size < BLOCKS:  # the first were seen while the baseline was still found
            found = found[found.size // 3 :]
        low, middle, high = np.quantile(found, (0.25, 0.5, 0.75))
        scale = max(high - low, LEAST_SPREAD * middle) / QUARTILES
        rare = middle + scale * (math.log(RETURN) + math.log(math.log(2.0)))
        enough = max(self.least, rare, MARGIN * float(found.max()))
        self.threshold = enough * (1.0 + FEW / found.size)

    def forget_newest(self) -> None:
        """What waits was perhaps not in order."""
        self._waiting.clear()


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
        prior = np.full(k.N_FEATURES, PRIOR * misfit**2)
        prior[0] = (0.05 * stroke / self.noise) ** 2  # where the sensor's zero lies is free
        prior[3] = 1.0  # the model's rate terms: right, or not there
        self._w, self._cov = np.zeros(k.N_FEATURES), np.diag(prior)
        h = model.hysteresis
        used = slice(0, 0 if h.static else h.n)
        self._hysteresis = (h.r[used], h.b[used], h.k[used], h.c, np.array([h.u_offset]))
        self._plays = initial_plays(h)[used]
        self._z, self._low = np.zeros(k.PLAYS.size), np.zeros(k.N_LOW)
        self._steps = np.zeros(k.STEPS)
        self._floors = np.full((3, k.N_CLASSES), misfit**2)
        self._weights = np.full((3, k.N_CLASSES), 0.25)
        self._past = np.full(self._lag + 1, np.nan)
        self._now = np.zeros(k.N_NOW)
        self._now[k.LEARN], self._now[k.MEMORY_S] = 1.0, k.FIRST_FLOOR_S
        self._block = np.zeros(k.N_BLOCK)
        self._phi, self._gain = np.zeros(k.N_FEATURES), np.zeros(k.N_FEATURES)
        self._blocks: deque[Floats] = deque(maxlen=WINDOW_S)
        self._misfit2 = misfit**2
        self._levels = {name: _Level(least) for name, least in FIGURES.items()}
        self.figures: dict[str, float] = dict.fromkeys((*FIGURES, "fit"), 0.0)
        self.mismatch = False
        self.seconds = self.motion_s = self._moved_s = 0

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
                drive, predicted, measured, self._scale, self._hysteresis, self._plays, self._every,
                self._lag, self.period_s, self._misfit2, self._w, self._cov, self._z, self._low,
                self._steps, self._floors, self._weights, self._past, self._now, self._block,
                self._phi, self._gain,
            )  # fmt: skip
            drive, predicted, measured = drive[taken:], predicted[taken:], measured[taken:]
            if self._now[k.BLOCK_S] >= 1.0:
                self._judge()
                judged = True
        return judged

    @property
    def learning(self) -> float:
        """Share of the first motion that is still to be seen; 0: it has learned enough."""
        return max(0.0, 1.0 - self.motion_s / LEARN_S)

    @property
    def health(self) -> float:
        """Largest figure over its threshold: below 1 in order. Below 0: still learning, and minus
        the share of the learning that is left."""
        worst = self._over(self.figures)
        return -self.learning if self.learning and worst <= 1.0 else worst

    @property
    def thresholds(self) -> dict[str, float]:
        """The figures' thresholds now."""
        now = {name: level.threshold for name, level in self._levels.items()}
        return {**(dict.fromkeys(now, math.inf) if self.learning else now), "fit": FIT}

    @property
    def cause(self) -> str:
        """The figure that is largest over its threshold."""
        limits = self.thresholds
        return max(limits, key=lambda name: self.figures[name] / limits[name])

    def _over(self, figures: dict[str, float]) -> float:
        return float(max(figures[name] / limit for name, limit in self.thresholds.items()))

    @property
    def stuck_s(self) -> float:
        """Seconds for which the reading has been the same to the last digit although the model
        moved; 0: it is not stuck."""
        moved = (self._now[k.STILL_HIGH] - self._now[k.STILL_LOW]) * self._scale[3]
        still_s = float(self._now[k.STILL_S])
        return still_s if still_s >= STUCK_S and moved > STUCK_MOVE * self.noise else 0.0

    def _judge(self) -> None:
        block = self._block.copy()
        self._blocks.append(block)
        self._block[:] = 0.0
        self._now[k.BLOCK_S] -= 1.0
        self.seconds += 1
        self._moved_s = 0 if _motion(block) > MOTION else self._moved_s + 1
        moving = bool(self._moved_s < MOVED_S and block[k.B_N] > 0.0)
        self.motion_s += moving
        blocks = list(self._blocks)
        self.figures = _figures(blocks, self._misfit2)
        if len(blocks) < SHORTEST_S:
            return
        # a large misfit need not wait for the long window
        health, newest = (
            self._over(self.figures),
            self._over(_figures(blocks[-SHORTEST_S:], self._misfit2)),
        )
        if health > 1.0 or newest > SUDDEN:
            self.mismatch = True
        elif health < CLEAR and newest < 1.0:
            self.mismatch = False
        for name, level in self._levels.items():
            if self.mismatch:
                level.forget_newest()
            elif moving and self.motion_s > SETTLED_S:
                level.see(self.figures[name])
        goes_on = not self.mismatch or self.motion_s < EARLY_S
        if self.motion_s > SETTLED_S:
            self._now[k.MEMORY_S] = k.FLOOR_S
        self._now[k.LEARN] = goes_on / (1.0 + max(0.0, 4.0 * health - 2.0))


def _motion(s: Floats) -> float:
    """Standard deviation of the displacement in the sums of a second [ranges]."""
    weight = max(s[k.B_W], 1e-12)
    return math.sqrt(max(0.0, s[k.B_PP] / weight - (s[k.B_P] / weight) ** 2))


def _figures(blocks: list[Floats], misfit2: float) -> dict[str, float]:
    """Figures of the sums of some seconds."""
    s = np.sum(blocks, axis=0)
    if s[k.B_N] < 1.0:
        return dict.fromkeys((*FIGURES, "fit"), 0.0)
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
        "all": float(s[k.B_WHOLE] / count),
        "ringing": float(s[k.B_RINGING] / count),
        "short": float(s[k.B_SHORT] / max(s[k.B_NSHORT], 1.0)),
        "fit": float(s[k.B_RAW2] / count - (s[k.B_RAW] / count) ** 2) / misfit2,
    }
