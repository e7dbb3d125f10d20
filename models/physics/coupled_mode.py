"""Coupling from another channel through a mode of the stage.

    y = x + gain q + quadrature q' / w,  q'' + 2 z w q' + w^2 q = w^2 (channel - reference)

The quadrature represents a delay of the channel, or damping that is not proportional.
The form is exact for a channel that is linear between the samples, for any damping z.
"""

from collections.abc import Mapping, Sequence

import numpy as np
from numba import njit

from dehyst.models.model import Block
from dehyst.models.physics.address import Kernel, fields, record
from dehyst.models.physics.candidate import Context, Parameter, Probe, format_length, other_causes
from dehyst.models.physics.coupling import Coupling
from dehyst.models.physics.entry import OTHER_AXIS, Physics, Scales, Specimen
from dehyst.models.physics.kind import Kind, Param, Solved, Values
from dehyst.models.physics.resonance import MODE, move_mode
from dehyst.models.signals.filters import mode
from dehyst.models.signals.joined import Data, Floats
from dehyst.models.signals.peaks import peaks

PACKED = fields("frequency", "damping", "gain", "reference", "per_speed")
STATE = fields("started", *MODE)


@njit(cache=True, nogil=True)
def _forward(p_at: int, s_at: int, x: float, dt: float, ch: float) -> float:
    p, s = record(p_at, PACKED), record(s_at, STATE)
    c = ch - p.reference
    if s.started == 0.0:
        s.q = s.x = c
        s.started = 1.0
    move_mode(s, p.frequency, p.damping, c, dt, False)
    return x + p.gain * s.q + p.per_speed * s.speed


@Kernel
def step(
    p_at: int, n_p: int, s_at: int, n_s: int, x: float, t: float, dt: float, ch: float
) -> float:
    """Forward."""
    return _forward(p_at, s_at, x, dt, ch)


@Kernel
def solve(
    p_at: int, n_p: int, s_at: int, n_s: int, y: float, t: float, dt: float, ch: float
) -> float:
    """Inverse."""
    return y - _forward(p_at, s_at, 0.0, dt, ch)


def _pack(values: Values, dt: float) -> Floats:
    frequency = values["frequency"][0]
    per_speed = values["quadrature"][0] / (2.0 * np.pi * frequency)
    gain, reference = values["gain"][0], values["reference"][0]
    return np.array([frequency, values["damping"][0], gain, reference, per_speed])


KIND = Kind(
    name="coupled_mode",
    says="coupling from another channel through a mode",
    places=("stage", "sensor"),
    params=(
        Param("frequency_hz", "frequency", "Hz", 1e-3, 1e6, "natural frequency"),
        Param("damping", "damping", "", 1e-6, 10.0, "damping ratio"),
        Param("gain_{y}_per_unit", "gain", "/unit", -1e6, 1e6, "gain per unit of the channel"),
        Param(
            "quadrature_{y}_per_unit",
            "quadrature",
            "/unit",
            -1e6,
            1e6,
            "gain per unit of the channel, of the mode's velocity over w",
            default=(0.0,),
        ),
        Param("reference", "reference", "", -1e9, 1e9, "channel at rest", default=(0.0,)),
    ),
    packed=PACKED,
    state=STATE,
    step=step,
    pack=_pack,
    inverse=Solved(solve, memory=True),
    channel=True,
)

MAX_MODES = 6
SAME_MODE = 0.01  # relative difference of frequencies below which two modes count as one


class CoupledMode(Coupling):
    """Coupling through modes of the stage that the other drive excites. Shown by the other channel
    with content near the modes."""

    equation = "y(t) = f(u) + sum_k g_k q_k + h_k q_k' / w_k, q'' + 2 z w q' + w^2 q = w^2 c(t)"
    source = "modes of the platform that several actuators drive"
    order = 62

    def __init__(self, data: Data, channel: str, reference: float) -> None:
        super().__init__(channel, reference, data.unit, data.drive_unit)
        self.key = f"coupledmode-{channel}"
        self.title = f"Coupling from {channel} through a mode"
        self.confused_with = ("resonance",)
        self._rate = 1.0 / data.period

    def params_at(self, theta: Sequence[float]) -> tuple[Parameter, ...]:
        rate = self._rate
        return tuple(
            p
            for tail in _tails(theta)
            for p in (
                Parameter(f"frequency{tail}_hz", "Hz", 1e-3 * rate, 0.5 * rate, sure=1.5e-3),
                Parameter(f"damping{tail}", "1", 5e-4, 0.3, sure=0.02),
            )
        )

    def starts(self, data: Data, residual: Floats) -> list[tuple[float, ...]]:
        # a peak of the residual is as wide as the mode, whose damping is 0.01 to 0.04
        near = (0.96, 0.98, 1.0, 1.02, 1.04)
        return [
            (f * g, z)
            for f in peaks(data, residual)
            if f < 0.45 * self._rate and _reaches(data, data.channels[self.channel], f)
            for g in near
            for z in (0.01, 0.04)
        ]

    def add_mode(self, theta: Sequence[float], data: Data, residual: Floats) -> tuple[float, ...]:
        if len(theta) >= 2 * MAX_MODES:
            return ()
        best: tuple[float, tuple[float, ...]] = (0.0, ())
        for start in self.starts(data, residual):
            if any(abs(start[0] / f - 1.0) < SAME_MODE for f in theta[::2]):
                continue
            x = self._mode(data, *start)[data.rows]
            x = x - x.mean(axis=0)
            moment = x.T @ residual[data.rows]
            gain = float(moment @ np.linalg.pinv(x.T @ x, hermitian=True) @ moment)
            best = max(best, (gain, (*theta, *start)))
        return best[1]

    def implausible(self, theta: Sequence[float], amplitudes: Floats, data: Data) -> str:
        gaps = np.diff(np.log(np.sort(theta[::2])))
        return "two of its modes coincide" if np.any(gaps < SAME_MODE) else ""

    def _mode(self, data: Data, frequency: float, damping: float) -> Floats:
        c = data.channels[self.channel] - self.reference
        return mode(c, 2 * np.pi * frequency * data.dt, damping, data.starts)

    def columns(self, data: Data, context: Context, theta: Sequence[float]) -> Floats:
        modes = zip(theta[::2], theta[1::2], strict=True)
        return np.concatenate([self._mode(data, f, z) for f, z in modes], axis=1)

    def values(self, theta: Sequence[float], amplitudes: Floats) -> dict[str, tuple[float, str]]:
        out = {}
        for tail, gain, quadrature in zip(
            _tails(theta), amplitudes[::2], amplitudes[1::2], strict=True
        ):
            size = float(np.copysign(np.hypot(gain, quadrature), gain))
            out[f"gain{tail}_um_per_unit"] = (size, self.limit_unit)
        for p, v in zip(self.params_at(theta), theta, strict=True):
            out[p.key] = (float(v), p.unit)
        return out

    def probes(self, data: Data) -> list[Probe]:
        return []

    def blocks(self, theta: Sequence[float], amplitudes: Floats, data: Data) -> tuple[Block, ...]:
        out = []
        parts = (theta[::2], theta[1::2], amplitudes[::2], amplitudes[1::2])
        for f, z, gain, quadrature in zip(*parts, strict=True):
            params: dict[str, float | tuple[float, ...]] = {
                "frequency_hz": float(f),
                "damping": float(z),
                f"gain_{data.unit}_per_unit": float(gain),
                f"quadrature_{data.unit}_per_unit": float(quadrature),
                "reference": self.reference,
            }
            out.append(Block("coupled_mode", "stage", params, self.channel))
        return tuple(out)

    def describe(self, values: Mapping[str, tuple[float, str]]) -> str:
        gains = [format_length(v) for k, v in values.items() if k.startswith("gain")]
        at = [f"{v:.4g}" for k, (v, _) in values.items() if k.startswith("frequency")]
        modes = " and ".join(f"{g} at {f} Hz" for g, f in zip(gains, at, strict=False))
        return (
            f"{self.whose} moves this reading through mechanical modes ({modes}): the axes are "
            "not decoupled, and the drives should avoid these frequencies."
        )


def _tails(theta: Sequence[float]) -> list[str]:
    """Return the suffix of each mode's parameter keys, which precedes the unit."""
    return [f"_{k + 1}" if k else "" for k in range(len(theta) // 2)]


def _reaches(data: Data, c: Floats, f: float) -> bool:
    """Return whether more than 1e-3 of a channel's power is within a fifth of a frequency."""
    power = whole = 0.0
    for p in np.unique(data.part):
        x = c[data.part == p]
        spectrum = np.abs(np.fft.rfft((x - x.mean()) * np.hanning(x.size))) ** 2
        at = np.fft.rfftfreq(x.size, float(data.dt[data.part == p][0]))
        whole += float(spectrum.sum())
        power += float(spectrum[np.abs(at - f) < 0.2 * f].sum())
    return power > 1e-3 * whole


def _variants(s: Scales) -> list[Block]:
    gain = {f"gain_{s.unit}_per_unit": 0.02 * s.stroke / s.span}
    f = 1.0 / s.period_s
    return [
        Block("coupled_mode", "stage", {"frequency_hz": k * f, "damping": 0.02, **gain}, OTHER_AXIS)
        for k in (0.05, 0.02, 0.1, 0.2)
    ]


PHYSICS = Physics(
    name="coupling",
    kinds=(KIND,),
    candidates=lambda data: [
        CoupledMode(data, c, float(data.channels[c].mean())) for c in other_causes(data)
    ],
    specimens={
        "coupled-mode": Specimen(
            _variants, "let the other axis' drive have content near the mode, and record it"
        )
    },
)
