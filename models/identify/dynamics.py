"""One piece of linear dynamics around the hysteresis, identified with it.

    drive    v = u + tau du/dt (lead), v(t) = u(t - tau) (delay), tau dv/dt + v = u (lag)
    sensor   a lag of first order, or a well-damped one of second order, on the displacement

A lead of a part of a sample is a convention: of a recorder that reads late, or of a stage whose
rate is the derivative and not the difference to the sample before. What stands behind the
hysteresis is taken to belong to the sensor and is never compensated; one recording of drive and
reading cannot tell a filter in the sensor from a servo around the stage.

A sensor's lag is applied to the columns of the equations, before the saturation; the written model
applies it behind. The two differ by the square of the lag times the curvature of the saturation.
"""

import math
from dataclasses import dataclass, replace

import numpy as np
from numba import njit

from dehyst.models.identify.data.rows import Rows, compute_rates
from dehyst.models.model import Block
from dehyst.models.physics import KINDS
from dehyst.models.recording import Bools, Floats
from dehyst.models.signals.filters import free_decay, lag_step, swing

SAME = 1e-9  # sampling intervals that differ by less than this part count as equal


@dataclass(frozen=True)
class Dynamics:
    """kind: "lead", "delay", "lag" or "second"; place: "drive" or "sensor"; theta: (tau,) in
    seconds, or (frequency in Hz, damping)."""

    kind: str
    place: str
    theta: tuple[float, ...]

    @property
    def block(self) -> Block:
        """The block of the model file."""
        if self.kind == "second":
            frequency, damping = self.theta
            numbers = {"frequency_hz": frequency, "damping": damping, "share": 1.0}
            return Block("resonance", self.place, dict(numbers))
        key = "delay_s" if self.kind == "delay" else "tau_s"
        return Block(self.kind, self.place, {key: self.theta[0]})

    @property
    def name(self) -> str:
        """In words, for people."""
        where = "of the drive" if self.place == "drive" else "of the sensor"
        if self.kind == "second":
            frequency, damping = self.theta
            return f"lag of second order {where}, {frequency:.3g} Hz, damping {damping:.2g}"
        return f"{self.kind} {where}, {1e3 * self.theta[0]:.3g} ms"

    @property
    def doubt(self) -> str:
        """What is to be said where this recording does not tell it from one of the sensor."""
        what = f"{self.name}: drive or sensor cannot be distinguished in this recording"
        taken = "it is attributed to the drive and compensated"
        if self.kind == "delay":
            return f"{what}, as a delay is the same before and after the hysteresis; {taken}"
        return (
            f"{what}; {taken}. A drive over the full range, of changing size and at up to "
            f"{0.05 / self.theta[0]:.2g} Hz, distinguishes them"
        )

    @property
    def delay_s(self) -> float:
        """By how much a slow move comes late [s]."""
        if self.kind == "second":
            return self.theta[1] / (math.pi * self.theta[0])
        return -self.theta[0] if self.kind == "lead" else self.theta[0]

    @property
    def short(self) -> bool:
        """A shift in time, beside which narrow operators may be free; what they would imitate of a
        lag they must not."""
        return self.kind in ("lead", "delay")

    def before(self, rows: Rows) -> Rows:
        """The rows with the drive as it reaches the hysteresis."""
        if self.place != "drive":
            return rows
        known = ~np.isnan(rows.u)
        kind = KINDS[self.kind]
        u = np.full(rows.u.size, np.nan)
        u[known] = kind.run(kind.values(self.block), rows.u[known], rows.t_s[known])
        rate, _ = compute_rates(rows.t_s, u, rows.period_s)
        return replace(rows, u=u, rate=rate)

    def behind(self, width: int) -> "Filter | None":
        """What passes `width` columns on, or None where nothing stands behind the hysteresis."""
        return None if self.place == "drive" else Filter(self, width)


class Filter:
    """A sensor's lag over many columns at once, lot after lot; exact for columns that run in
    straight lines between the rows."""

    def __init__(self, lag: Dynamics, width: int) -> None:
        self._theta = np.array(lag.theta)
        self._state = np.zeros((3, width))  # output, its speed, input before
        self._last = np.full(1, np.nan)  # time before

    def run(self, x: Floats, t_s: Floats, fresh: Bools) -> None:
        """Filter x (n, width) in place. fresh: (n,) rows at which it starts settled."""
        _filter_columns(x, t_s, fresh, self._theta, self._state, self._last)


@njit(cache=True, nogil=True)
def _filter_columns(
    x: Floats, t_s: Floats, fresh: Bools, theta: Floats, state: Floats, last: Floats
) -> None:
    y, speed, before = state[0], state[1], state[2]
    step, trail, fall, decay = -1.0, 0.0, 0.0, (1.0, 0.0, 0.0, 1.0)
    for t in range(x.shape[0]):
        dt = t_s[t] - last[0]
        last[0] = t_s[t]
        if fresh[t] or np.isnan(dt):
            for i in range(x.shape[1]):
                y[i] = before[i] = x[t, i]
                speed[i] = 0.0
            continue
        if abs(dt - step) > SAME * dt:
            step = dt
            if theta.size == 1:
                trail = theta[0]
                fall = math.exp(-dt / trail)
            else:
                w, z = 2.0 * math.pi * theta[0], theta[1]
                trail = 2.0 * z / w
                decay = free_decay(w, z, dt)
        for i in range(x.shape[1]):
            ramp = (x[t, i] - before[i]) / dt
            if theta.size == 1:
                y[i] = lag_step(y[i], before[i], x[t, i], trail * ramp, fall)
            else:
                y[i], speed[i] = swing(
                    y[i], speed[i], before[i], x[t, i], ramp, trail * ramp, decay
                )
            before[i] = x[t, i]
            x[t, i] = y[i]
