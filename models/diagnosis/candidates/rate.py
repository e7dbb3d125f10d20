"""Rate dependence of the hysteresis itself: loops that widen with the rate."""

from collections.abc import Mapping, Sequence

import numpy as np
from numba import njit

from dehyst.models.diagnosis.candidates.interface import Candidate, Context, Parameter
from dehyst.models.diagnosis.data import Bools, Data, Floats
from dehyst.models.model import Block

FRACTIONS = np.array([0.01, 0.03, 0.08, 0.2])  # thresholds, of the drive's range
SMOOTHING = 2.0  # sampling periods


class Rate(Candidate):
    """sum_i g_i |dv/dt|^p (v - H_i) + k_i dv/dt H_i."""

    name = key = "rate"
    title = "Loops that change with the rate"
    equation = "y + sum_i g_i |dv/dt|^p (v - H_i) + k_i dv/dt H_i"
    source = "thresholds dilating with the rate (Al Janaideh 2009); Qin et al., Eq. 5"
    typical = "loops some 10 % wider at 10 Hz than at 0.1 Hz"
    revealed_by = "the same stroke at several frequencies, and several strokes at one"
    confused_with = ("lag", "delay", "friction")
    order = 65
    static = True

    parameters = (Parameter("power", "1", 0.2, 2.0),)

    def starts(self, data: Data, residual: Floats) -> list[tuple[float, ...]]:
        return [(0.5,), (1.0,)]

    def columns(self, data: Data, context: Context, theta: Sequence[float]) -> Floats:
        v = (context.v - data.u_min) * (2.0 / data.span)
        tau = SMOOTHING * data.period
        return _columns(v, data.dt, data.starts, 2.0 * FRACTIONS, theta[0], tau)

    def values(self, theta: Sequence[float], amplitudes: Floats) -> dict[str, tuple[float, str]]:
        return {"power": (float(theta[0]), "1")}

    def blocks(self, theta: Sequence[float], amplitudes: Floats, data: Data) -> tuple[Block, ...]:
        n = FRACTIONS.size
        params: dict[str, float | tuple[float, ...]] = {
            f"thresholds_{data.drive_unit}": tuple(float(r) for r in FRACTIONS * data.span),
            "widening": tuple(float(a) for a in amplitudes[:n]),
            "slopes": tuple(float(a) for a in amplitudes[n:]),
            "power": float(theta[0]),
            "smoothing_s": SMOOTHING * data.period,
            f"scale_{data.drive_unit}": 0.5 * data.span,
            f"center_{data.drive_unit}": data.u_min,
        }
        return (Block("rate", "stage", params),)

    def says(self, values: Mapping[str, tuple[float, str]]) -> str:
        return (
            "The loops change with the rate in a way that no lag of the amplifier or the sensor "
            "makes: identify with rate-dependent weights over the band that you use."
        )


@njit(cache=True, nogil=True)
def _columns(v: Floats, dt: Floats, starts: Bools, r: Floats, power: float, tau: float) -> Floats:
    n = r.size
    out = np.empty((v.size, 2 * n))
    h = np.zeros(n)
    smooth = 0.0
    for t in range(v.size):
        if starts[t]:
            h[:] = 0.0
            smooth = 0.0
        else:
            keep = np.exp(-dt[t] / tau)
            smooth = keep * smooth + (1.0 - keep) * (v[t] - v[t - 1]) / dt[t]
        strength = abs(smooth) ** power
        for i in range(n):
            h[i] = max(v[t] - r[i], min(v[t] + r[i], h[i]))
            out[t, i] = strength * (v[t] - h[i])
            out[t, n + i] = smooth * h[i]
    return out


def candidates(data: Data) -> list[Candidate]:
    return [Rate()]
