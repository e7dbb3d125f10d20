"""Estimate the stage's position where the filter of its gauge lags.

Each step of the output makes a stage ring, and a reading taken soon after it shows the ringing
late. A first-order filter with time constant tau reads r with tau dr/dt + r = x, so the stage is at
x = r + tau dr/dt, and the rate of the reading is needed at the time when it is taken. One reading
per period does not show that rate. But the time between steps and readings varies a little at
random from pass to pass, and the reading varies with it, in proportion to its rate. Let v_j be the
step of the output j periods ago, and d_j how much longer ago it was than on average. Then

    reading - its mean at this place of the pass = sum_j g_j v_j d_j,      dr/dt = sum_j g_j v_j,

and the g_j follow by least squares over all passes. The modes need not be known. Where the times do
not vary, or the readings do not show an effect, nothing is added.
"""

import numpy as np

from dehyst.models.learning.tuning import TUNING
from dehyst.models.model import Floats
from dehyst.models.recording import Bools


class LateGauge:
    """Learn, pass by pass, how far a stage is ahead of the readings of a gauge whose filter has the
    time constant filter_s. `back`: number of steps that are used; `error_redefined`: the newest
    pass is the first with an estimate other than 0."""

    def __init__(self, filter_s: float) -> None:
        self.filter_s, self.back = filter_s, TUNING.late_back
        self.error_redefined, self._reported = False, False
        self._begun = self._passes = 0
        self._mean_x: Floats | None = None  # (n, back)
        self._mean_y: Floats | None = None  # (n,)
        self._gram = np.zeros((self.back, self.back))
        self._moment = np.zeros(self.back)
        self._power = 0.0

    def take(self, repeats: Floats, steps: Floats, since_s: Floats) -> Floats:
        """Return (n,) how far the stage is ahead in this pass; a pass with a NaN gives 0.

        repeats: (n,) reading minus target and learned correction; steps: (n, back) steps of the
        output before each reading, the newest first; since_s: (n, back) time since each step.
        """
        ahead = self._ahead(repeats, steps, since_s)
        self.error_redefined = not self._reported and bool(ahead.any())
        self._reported |= self.error_redefined
        return ahead

    def _ahead(self, repeats: Floats, steps: Floats, since_s: Floats) -> Floats:
        known = np.isfinite(repeats) & np.isfinite(steps).all(axis=1)
        known &= np.isfinite(since_s).all(axis=1)
        self._begun += 1
        if not known.all() or self._begun <= TUNING.settling:
            return np.zeros(repeats.size)  # this pass is not learned from
        ago = np.arange(self.back) * float(np.median(np.diff(since_s, axis=1)))
        off = since_s - ago - float(np.median(since_s[:, 0]))
        usual = np.abs(off) <= TUNING.late_usual * float(np.median(np.abs(off)))
        self._add(steps * off, repeats - repeats.mean(), np.asarray(usual.all(axis=1)))
        g, cov = self._rates()
        rate = steps @ g
        noise = float(np.sum((steps.T @ steps) * cov)) / rate.size
        power = float(np.mean(rate**2))
        if not power > 0.0:
            return np.zeros(repeats.size)
        weight = max(0.0, 1.0 - TUNING.late_noises * noise / power)
        return np.asarray(self.filter_s * weight * rate, np.float64)

    def _add(self, x: Floats, y: Floats, usual: Bools) -> None:
        """Update the sums of squares about the mean at each place of the pass (B. P. Welford,
        Technometrics 4, 1962, 419). usual: (n,) rows whose times are usable; a process that was
        held up by others records a time that was not the output's."""
        self._passes += 1
        if self._mean_x is None or self._mean_y is None:
            self._mean_x, self._mean_y = x * usual[:, None], y.copy()
            return
        dx, dy = (x - self._mean_x) * usual[:, None], (y - self._mean_y) * usual
        part = (self._passes - 1) / self._passes
        self._gram += part * (dx.T @ dx)
        self._moment += part * (dx.T @ dy)
        self._power += part * float(dy @ dy)
        self._mean_x += dx / self._passes
        self._mean_y += dy / self._passes

    def _rates(self) -> tuple[Floats, Floats]:
        """Return the g_j (back,) and their covariance; zeros where they cannot be estimated."""
        nothing = np.zeros(self.back), np.zeros((self.back, self.back))
        size = np.sqrt(np.diag(self._gram))
        if self._passes < TUNING.late_passes or self._mean_y is None or not size.min() > 0.0:
            return nothing
        normed = self._gram / np.outer(size, size)
        if np.linalg.cond(normed) > TUNING.late_condition:
            return nothing
        inverse = np.linalg.inv(normed) / np.outer(size, size)
        g = inverse @ self._moment
        free = max((self._passes - 1) * self._mean_y.size - self.back, 1)
        left = max(self._power - float(g @ self._moment), 0.0) / free
        return g, left * inverse
