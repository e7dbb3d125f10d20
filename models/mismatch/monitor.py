"""The mismatch monitor: does the stage still behave as its model predicts? Takes drives and
readings, returns health.

No model fits exactly: it lacks creep, has no hysteresis between its thresholds, ignores a bridge
that warms up. That part of the misfit repeats itself, and the monitor learns it online: the
residual (measured - predicted) is explained by a linear baseline

    e_k = w' phi_k + noise
    phi = (1, p, p^2, the part of p that comes from the model's own rate terms,
           newest steps of x, p times them, x - play_r(x), p (x - play_r(x)),
           and p, p^2 and x each less its low pass with time constant tau)

with x the drive and p the predicted displacement, both as shares of their range. The weights w are
tracked by a Kalman filter that forgets slowly (West & Harrison, Bayesian Forecasting and Dynamic
Models, ch. 4). The remainder is judged over the last window_s, in units of the noise that the model
states, against noise floors that are learned for each class of motion:

    gain      power along the displacement and along its creep response
    offset    square of the mean: drift, a shifted zero
    whole     all power but the mean's
    all       all power, including the mean's
    ringing   power of what changes within smooth_s: resonance, hum
    short     power of differences over half a millisecond: noise, fast ringing
    fit       power of the residual itself, without baseline, relative to the model's stated misfit,
              since the drive last went beyond its earlier range: what the stage remembers from
              before the monitor started is not known, and such moves erase it

During the first learn_s of motion (seconds in which the stage moves, or has just moved) it only
learns and reports nothing but a very large `fit`. From then on each figure has a threshold: the
value exceeded once in return_blocks blocks of block_s, from a Gumbel distribution through the
quartiles of the largest values of the blocks without mismatch (Coles, An Introduction to
Statistical Modeling of Extreme Values, ch. 3), and at least margin times the largest of all and at
least the figure's least threshold; it is higher while few blocks were seen. health is the largest
ratio of a figure to its threshold: below 1 in order, above 1 `mismatch`, until all are below clear
again; negative while still learning. No threshold learns during a mismatch, and after the first
early_s of motion the baseline does not either, except for its zero. Where the drive goes beyond its
earlier range, the zero may shift. Pure: no clock, no files. The constants are in tuning.py.
"""

import math
from collections import deque
from typing import Any

import numpy as np

from dehyst.models.hysteresis.forward import initial_plays, simulate_hysteresis
from dehyst.models.mismatch import kernel
from dehyst.models.mismatch.tuning import LEAST, QUARTILES, TUNING
from dehyst.models.model import Floats, Hysteresis, Model, Validity
from dehyst.models.recording import Bools


class _Level:
    """Threshold of one figure: the value that it hardly ever exceeds while the stage is in
    order."""

    def __init__(self, least: float, block_s: int) -> None:
        self.least, self.threshold, self._block_s = least, math.inf, block_s
        self._largest: deque[float] = deque(maxlen=TUNING.blocks)  # of each block
        self._block: list[float] = []
        self._waiting: deque[float] = deque()

    def see(self, figure: float) -> None:
        """Add one second's figure, recorded in order; it counts once it is old enough."""
        self._waiting.append(figure)
        if len(self._waiting) <= TUNING.delay_s:
            return
        self._block.append(self._waiting.popleft())
        if len(self._block) == self._block_s:
            self._largest.append(max(self._block))
            self._block = []
            self._learn()

    def _learn(self) -> None:
        found = np.array(self._largest)
        if found.size < TUNING.blocks:  # the first were seen before the baseline converged
            found = found[found.size // 3 :]
        low, middle, high = np.quantile(found, (0.25, 0.5, 0.75))
        scale = max(high - low, TUNING.least_spread * middle) / QUARTILES
        rare = middle + scale * (math.log(TUNING.return_blocks) + math.log(math.log(2.0)))
        enough = max(self.least, rare, TUNING.margin * float(found.max()))
        self.threshold = enough * (1.0 + TUNING.few / found.size)

    def forget_newest(self) -> None:
        """Discard the waiting figures, which may not have been in order."""
        self._waiting.clear()


class MismatchMonitor:
    """Monitors one stage against one model.

    model: the one that the loop runs; period_s: the loop's period; learn_s: seconds of motion
    before the first flag; the other learning times scale with it. Units are the model's. figures,
    thresholds: by name, of the newest second.
    """

    def __init__(self, model: Model, period_s: float, learn_s: float = TUNING.learn_s) -> None:
        part = min(1.0, learn_s / TUNING.learn_s)
        self._learn_s, self._settled_s = learn_s, part * TUNING.settled_s
        self._early_s = max(learn_s, part * TUNING.early_s)
        block_s = max(1, round(part * TUNING.block_s))
        v = model.validity
        ends = simulate_hysteresis(
            model.hysteresis, np.array([v.drive_min, v.drive_max, v.drive_min]), 1e9
        )
        stroke = max(float(np.ptp(ends)), 1e-12)
        fit = model.fit
        # 0.002 of the stroke stands for a noise that is not stated; 1e-5 of it is above rounding
        self.noise = max(fit.noise_rms or fit.rms or 0.002 * stroke, 1e-5 * stroke)
        # a claim may be absent or too small, so twice the noise is the least misfit
        misfit = max(fit.claim or 0.0, 2.0 * self.noise) / self.noise
        lag = max(1, round(1.0 / (period_s * TUNING.fast_hz)))
        prior = np.full(kernel.N_FEATURES, TUNING.prior * misfit**2)
        prior[0] = (0.05 * stroke / self.noise) ** 2  # the sensor's zero is free
        prior[3] = 1.0  # the model's rate terms: correct, or absent
        h = model.hysteresis
        used = slice(0, 0 if h.static else h.n)
        self._plant = kernel.Plant(
            scale=np.array(
                [v.drive_min, v.drive_max - v.drive_min, float(ends.min()), stroke, self.noise]
            ),
            r=h.r[used],
            b=h.b[used],
            k=h.k[used],
            c=h.c,
            offset=float(h.u_offset),
            every=max(1, round(1.0 / (period_s * TUNING.slow_hz))),
            lag=lag,
            dt=float(period_s),
            misfit2=float(misfit**2),
        )
        self._state = kernel.MonitorState(
            w=np.zeros(kernel.N_FEATURES),
            cov=np.diag(prior),
            plays=initial_plays(h)[used],
            z=np.zeros(kernel.PLAYS.size),
            low=np.zeros(kernel.N_LOW),
            steps=np.zeros(TUNING.steps),
            floors=np.full((3, kernel.N_CLASSES), misfit**2),
            weights=np.full((3, kernel.N_CLASSES), 0.25),  # s, below trust_s
            past=np.full(lag + 1, np.nan),
            now=np.zeros(1, kernel.NOW),
            sums=np.zeros(1, kernel.SUMS),
            phi=np.zeros(kernel.N_FEATURES),
            gain=np.zeros(kernel.N_FEATURES),
        )
        now = self._state.now[0]
        now["learn"], now["memory_s"] = 1.0, TUNING.first_floor_s
        self._window: deque[Floats] = deque(maxlen=TUNING.window_s)
        self._levels = {name: _Level(least, block_s) for name, least in LEAST.items()}
        self.figures: dict[str, float] = dict.fromkeys((*LEAST, "fit"), 0.0)
        self._newest = self.figures  # of the last seconds alone
        self.mismatch = False
        self.seconds = self.motion_s = self._moved_s = 0

    def update(
        self,
        drive: Floats,
        predicted: Floats,
        measured: Floats,
        good: Bools,
        correction: Floats | float = 0.0,
    ) -> bool:
        """Process a batch of samples: (n,) drive in force at each reading [drive unit], predicted
        reading, the reading, whether it is fresh and valid, and what was added to the target
        because of the gauge. Return True when a second was completed and judged.

        A correction makes the drive follow the very residual that is judged. So that the baseline
        does not take one for the cause of the other, the correction is subtracted from drive and
        displacement.
        """
        _, span, _, stroke, _ = self._plant.scale
        drive = np.ascontiguousarray(drive - correction * (span / stroke), np.float64)
        predicted = np.ascontiguousarray(predicted - correction, np.float64)
        measured = np.where(good, measured - correction, np.nan)
        judged = False
        while drive.size:
            taken = kernel.watch_sample(self._plant, self._state, drive, predicted, measured)
            drive, predicted, measured = drive[taken:], predicted[taken:], measured[taken:]
            if self._state.now[0]["second_s"] >= 1.0:
                self._judge()
                judged = True
        return judged

    @property
    def learning(self) -> float:
        """Share of the first motion still to be seen; 0: it has learned enough."""
        return max(0.0, 1.0 - self.motion_s / self._learn_s)

    @property
    def health(self) -> float:
        """Largest ratio of a figure to its threshold: below 1 in order. Below 0: still learning,
        and minus the remaining share of the learning."""
        return -self.learning if self.learning and not self.mismatch else self._worst()

    @property
    def thresholds(self) -> dict[str, float]:
        """Current thresholds of the figures."""
        now = {name: level.threshold for name, level in self._levels.items()}
        return {**(dict.fromkeys(now, math.inf) if self.learning else now), "fit": TUNING.fit}

    @property
    def cause(self) -> str:
        """The figure with the largest ratio to its threshold."""
        limits = self.thresholds
        return max(limits, key=lambda name: self.figures[name] / limits[name])

    def _worst(self) -> float:
        """Return the largest ratio of the long window, or of the newest seconds, which have wider
        thresholds."""
        return max(self._compare(self.figures), self._compare(self._newest) / TUNING.sudden)

    def _compare(self, figures: dict[str, float]) -> float:
        return float(max(figures[name] / limit for name, limit in self.thresholds.items()))

    @property
    def stuck_s(self) -> float:
        """Seconds for which the reading has been identical to the last digit although the model
        moved; 0: it is not stuck."""
        now = self._state.now[0]
        moved = (now["still_high"] - now["still_low"]) * self._plant.scale[3]
        stuck = now["still_s"] >= TUNING.stuck_s and moved > TUNING.stuck_move * self.noise
        return float(now["still_s"]) if stuck else 0.0

    def _judge(self) -> None:
        self._window.append(self._state.sums.view(np.float64).copy())
        self._state.sums[:] = np.zeros(1, kernel.SUMS)
        self._state.now[0]["second_s"] -= 1.0
        self.seconds += 1
        last = self._window[-1].view(kernel.SUMS)[0]
        self._moved_s = 0 if _measure_motion(last) > TUNING.motion else self._moved_s + 1
        moving = bool(self._moved_s < TUNING.moved_s and last["n"] > 0.0)
        self.motion_s += moving
        sums, misfit2 = list(self._window), self._plant.misfit2
        self.figures = _compute_figures(sums, misfit2)
        if len(sums) < TUNING.shortest_s:
            return
        # a large misfit need not wait for the long window
        health = self._compare(self.figures)
        self._newest = _compute_figures(sums[-TUNING.shortest_s :], misfit2)
        newest = self._compare(self._newest)
        if health > 1.0 or newest > TUNING.sudden:
            self.mismatch = True
        elif health < TUNING.clear and newest < 1.0:
            self.mismatch = False
        for name, level in self._levels.items():
            if self.mismatch:
                level.forget_newest()
            elif moving and self.motion_s > self._settled_s:
                level.see(self.figures[name])
        goes_on = not self.mismatch or self.motion_s < self._early_s
        if self.motion_s > self._settled_s:
            self._state.now[0]["memory_s"] = TUNING.floor_s
        # the baseline learns more slowly from half the threshold on, a third as fast at it
        self._state.now[0]["learn"] = goes_on / (1.0 + max(0.0, 4.0 * health - 2.0))


def compile_monitor() -> None:
    """Compile what a monitor runs, or load it from the cache, before it is needed, with four dummy
    samples."""
    plays = Hysteresis(np.array([0.0, 1.0]), np.array([1.0, 0.1]), np.array([0.0, 1.0]))
    model = Model(plays, Validity(0.0, 10.0))
    nothing = np.zeros(4)
    MismatchMonitor(model, 1e-3).update(nothing, nothing, nothing, np.zeros(4, np.bool_))


def _measure_motion(s: Any) -> float:
    """Return the standard deviation of the displacement from the sums of a second [ranges]."""
    weight = max(s["w"], 1e-12)
    return math.sqrt(max(0.0, s["pp"] / weight - (s["p"] / weight) ** 2))


def _compute_figures(sums: list[Floats], misfit2: float) -> dict[str, float]:
    """Return the figures from the sums of some seconds."""
    s = np.sum(sums, axis=0).view(kernel.SUMS)[0]
    if s["n"] < 1.0:
        return dict.fromkeys((*LEAST, "fit"), 0.0)
    weight, mean = s["w"], s["e"] / s["w"]
    ways = np.array([s["p"], s["c"]])
    square = np.array([[s["pp"], s["pc"]], [s["pc"], s["cc"]]])
    square -= np.outer(ways, ways) / weight
    along = np.array([s["pe"], s["ce"]]) - ways * mean
    explained = along @ np.linalg.pinv(square, rcond=1e-3, hermitian=True) @ along
    count = s["n"]
    return {
        "gain": max(0.0, float(explained)) / count,
        "offset": float(mean**2) * weight / count,
        "whole": max(0.0, float(s["whole"] - mean**2 * weight) / count),
        "all": float(s["whole"] / count),
        "ringing": float(s["ringing"] / count),
        "short": float(s["short"] / max(s["n_short"], 1.0)),
        "fit": _measure_fit(sums) / misfit2,
    }


def _measure_fit(sums: list[Floats]) -> float:
    """Return the variance of the residual since its sums were last reset [noises squared]."""
    anew = [k for k, one in enumerate(sums) if one.view(kernel.SUMS)[0]["raw_anew"]]
    s = np.sum(sums[anew[-1] if anew else 0 :], axis=0).view(kernel.SUMS)[0]
    count = max(s["n_raw"], 1.0)
    return float(s["raw2"] / count - (s["raw"] / count) ** 2)
