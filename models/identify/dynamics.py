"""Apply the linear dynamics that are identified with a hysteresis to the equations of a fit.

A sensor's lag is applied to the columns of the equations, before the saturation; the written model
applies it after the saturation. The two differ by the square of the lag times the curvature of the
saturation.
"""

import math
from dataclasses import replace

import numpy as np
from numba import njit

from dehyst.models.identify.data.rows import Rows, compute_rates
from dehyst.models.physics import KINDS
from dehyst.models.physics.dynamics import Dynamics
from dehyst.models.recording import Bools, Floats
from dehyst.models.signals.filters import free_decay, lag_step, second_order_step

SAME = 1e-9  # sampling intervals that differ by less than this part count as equal


def rows_behind(lag: Dynamics, rows: Rows) -> Rows:
    """Return the rows with the drive as it reaches the hysteresis."""
    if lag.place != "drive":
        return rows
    known = ~np.isnan(rows.u)
    u = rows.u.copy()
    for block in lag.blocks:
        kind = KINDS[block.kind]
        u[known] = kind.run(kind.values(block), u[known], rows.t_s[known])
    rate, _ = compute_rates(rows.t_s, u, rows.period_s)
    return replace(rows, u=u, rate=rate)


class Filter:
    """Apply a sensor's lag to many columns at once, lot after lot; exact for columns that change
    linearly between the rows, or that are held."""

    def __init__(self, lag: Dynamics, width: int) -> None:
        self._theta, self._held, self._late = np.array(lag.theta), lag.held, lag.late_s > 0.0
        self._state = np.zeros((3, width))  # output, its speed, input before
        self._last = np.full(1, np.nan)  # time before

    def run(self, x: Floats, t_s: Floats, fresh: Bools) -> None:
        """Filter x (n, width) in place. fresh: (n,) rows at which the filter restarts settled. An
        input that is late is the one of the row before."""
        _filter_columns(x, t_s, fresh, self._theta, self._held, self._late, self._state, self._last)


@njit(cache=True, nogil=True)
def _filter_columns(
    x: Floats,
    t_s: Floats,
    fresh: Bools,
    theta: Floats,
    held: bool,
    late: bool,
    state: Floats,
    last: Floats,
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
        row = x[t]
        if held or late:  # the input stood still since the row before
            for i in range(row.size):
                now = before[i] if late else row[i]
                before[i] = row[i]
                if theta.size == 1:
                    y[i] = lag_step(y[i], now, now, 0.0, fall)
                else:
                    y[i], speed[i] = second_order_step(y[i], speed[i], now, now, 0.0, 0.0, decay)
                row[i] = y[i]
        elif theta.size == 1:
            for i in range(row.size):
                now, ramp = row[i], (row[i] - before[i]) / dt
                y[i] = lag_step(y[i], before[i], now, trail * ramp, fall)
                before[i], row[i] = now, y[i]
        else:
            for i in range(row.size):
                now, ramp = row[i], (row[i] - before[i]) / dt
                y[i], speed[i] = second_order_step(
                    y[i], speed[i], before[i], now, ramp, trail * ramp, decay
                )
                before[i], row[i] = now, y[i]
