"""First-order lag: tau dy/dt + y = x (amplifier into the stack's capacitance, sensor filter).

The form is exact for an input that is linear between the samples, or held (`kind.HELD`). A servo
around the stage is also recognised here, as a second-order lag; its block is a resonance that does
not ring.
"""

import math
from collections.abc import Callable, Mapping, Sequence

import numpy as np

from dehyst.models.model import Block
from dehyst.models.physics.address import Kernel, fields, record
from dehyst.models.physics.candidate import Candidate, Parameter, Probe
from dehyst.models.physics.delay import OF_A_SAMPLE
from dehyst.models.physics.entry import Physics, Scales, Specimen
from dehyst.models.physics.kind import (
    HELD,
    SAME,
    Kind,
    Led,
    Param,
    Values,
    head_record,
    held_key,
)
from dehyst.models.signals.filters import lag_step, lowpass, second_order
from dehyst.models.signals.joined import Data, Floats

PACKED = fields("tau", "hold")  # s; hold: 0 where the input moves in straight lines
STATE = fields("y", "x", "dt", "decay")  # output, previous input, dt of the decay, decay


@Kernel
def step(
    p_at: int, n_p: int, s_at: int, n_s: int, x: float, t: float, dt: float, ch: float
) -> float:
    """Forward."""
    p, s = record(p_at, PACKED), record(s_at, STATE)
    if dt > 0.0:
        if abs(dt - s.dt) > SAME * dt:
            s.dt = dt
            s.decay = math.exp(-dt / p.tau)
        before = x if p.hold > 0.0 else s.x
        trail = p.tau * ((x - before) / dt)
        s.y = lag_step(s.y, before, x, trail, s.decay)
    s.x = x
    return s.y


def _pack(values: Values, dt: float) -> Floats:
    return np.array([values["tau"][0], values["held"][0] * dt])


def _lead(p: Floats) -> tuple[float, float]:
    """Return the lag of a steady ramp at the samples [s], and 0."""
    tau, hold = p
    if hold == 0.0:
        return tau, 0.0
    decay = math.exp(-hold / tau)
    return hold * decay / (1.0 - decay), 0.0


def _start(p: Floats, s: Floats, x: float) -> None:
    state = head_record(s, STATE)
    state["y"] = state["x"] = x


KIND = Kind(
    name="lag",
    says="a first-order lag",
    places=("drive", "stage", "sensor"),
    params=(Param("tau_s", "tau", "s", 1e-9, 100.0, "time constant"), HELD),
    packed=PACKED,
    state=STATE,
    step=step,
    pack=_pack,
    start=_start,
    inverse=Led(_lead),
)


class Lag(Candidate):
    """tau dv/dt + v = u for the drive, or the same on the reading; two poles: two in series.
    Typical: 0.1 to 5 ms; shown by content above 0.1 / tau: steps, fast chirps."""

    name = "lag"
    limit_unit = "s"
    late = True
    size_index = 0
    equation = "tau dx/dt + x = x_in, 1 / (tau s + 1)"
    source = "amplifier with the stack's capacitance (RC), or the sensor's filter"
    confused_with = ("delay", "resonance", "slew", "rate")

    def __init__(self, data: Data, place: str, poles: int) -> None:
        self.place = place
        self.poles = poles
        self.mode = "drive" if place == "drive" else "output"
        self.key = f"lag-{place}" if poles == 1 else f"lag{poles}-{place}"
        self.refines = () if poles == 1 else (f"lag-{place}",)
        self.contains = () if poles == 1 else ("lag",)
        self.order = 3 if place == "drive" else 40
        self.title = "Lag of the amplifier" if place == "drive" else "Lag of the sensor"
        self.parameters = tuple(
            Parameter(
                f"tau_{k + 1}_s" if k else "tau_s",
                "s",
                0.02 * data.period,
                300.0 * data.period,
                within=OF_A_SAMPLE * data.path.period,
            )
            for k in range(poles)
        )

    def starts(self, data: Data, residual: Floats) -> list[tuple[float, ...]]:
        return [
            (data.period * k,) + (0.3 * data.period * k,) * (self.poles - 1)
            for k in (0.3, 1.0, 3.0, 10.0, 30.0)
        ]

    def refined_start(self, theta: Sequence[float]) -> tuple[float, ...]:
        return (0.7 * theta[0], 0.3 * theta[0])

    def _pass(self, data: Data, x: Floats, theta: Sequence[float]) -> Floats:
        for tau in theta:
            x = lowpass(x, data.dt / tau, data.starts, data.stepped)
        return x

    def drive(self, data: Data, v: Floats, theta: Sequence[float]) -> Floats:
        return self._pass(data, v[:, None], theta)[:, 0]

    def output(self, data: Data, x: Floats, theta: Sequence[float]) -> Floats:
        return self._pass(data, x, theta)

    def probes(self, data: Data) -> list[Probe]:
        taus = data.period * np.geomspace(0.02, 100, 13) if self.poles == 1 else ()
        return [Probe(float(tau), (float(tau),)) for tau in taus]

    def blocks(self, theta: Sequence[float], amplitudes: Floats, data: Data) -> tuple[Block, ...]:
        held = held_key(data)
        return tuple(Block("lag", self.place, {"tau_s": float(tau), **held}) for tau in theta)

    def describe(self, values: Mapping[str, tuple[float, str]]) -> str:
        tau = sum(v for v, _ in values.values())
        corner = 1.0 / (2.0 * math.pi * tau)
        if self.place == "drive":
            return (
                f"The amplifier lags with a time constant of {1e3 * tau:.3g} ms (corner "
                f"{corner:.3g} Hz), as with a resistor in series with the stack's capacitance."
            )
        return (
            f"The reading is low-pass filtered with a time constant of {1e3 * tau:.3g} ms (corner "
            f"{corner:.3g} Hz), as by a filter in the sensor."
        )


class Servo(Candidate):
    """w^2 / (s^2 + 2 z w s + w^2), damped enough not to ring: a closed loop around the stage, or a
    second-order filter (Butterworth: z = 0.71). Typical: 10 Hz to some kHz; shown by content above
    a tenth of the corner: steps, fast chirps."""

    name = "lag"
    key = "lag-second"
    title = "Second-order lag"
    equation = "w^2 / (s^2 + 2 z w s + w^2), z above 0.45"
    source = "a position servo around the stage, or a filter of second order"
    confused_with = ("delay", "resonance", "slew", "rate")
    order = 41
    place = "sensor"
    mode = "output"
    late = True

    def __init__(self, data: Data) -> None:
        rate = 1.0 / data.period
        self.parameters = (
            Parameter("corner_hz", "Hz", 5e-4 * rate, 4.0 * rate),
            Parameter("damping", "1", 0.45, 1.5),
        )

    def starts(self, data: Data, residual: Floats) -> list[tuple[float, ...]]:
        return [(f / data.period, 0.75) for f in (0.004, 0.012, 0.04, 0.12, 0.4)]

    def output(self, data: Data, x: Floats, theta: Sequence[float]) -> Floats:
        w = 2 * np.pi * theta[0] * data.dt
        return second_order(x, w, theta[1], data.starts, data.stepped)

    def blocks(self, theta: Sequence[float], amplitudes: Floats, data: Data) -> tuple[Block, ...]:
        params: dict[str, float | tuple[float, ...]] = {
            "frequency_hz": float(theta[0]),
            "damping": float(theta[1]),
            "share": 1.0,
            **held_key(data),
        }
        return (Block("resonance", "sensor", params),)

    def describe(self, values: Mapping[str, tuple[float, str]]) -> str:
        f, z = values["corner_hz"][0], values["damping"][0]
        return (
            f"The reading has a second-order lag (corner {f:.3g} Hz, damping {z:.2g}; "
            f"{2e3 * z / (2.0 * math.pi * f):.3g} ms in slow motion), as from a position servo or "
            "a steep filter."
        )


def _candidates(data: Data) -> list[Candidate]:
    first: list[Candidate] = [
        Lag(data, place, poles) for poles in (1, 2) for place in ("drive", "sensor")
    ]
    return [*first, Servo(data)]


def _variants(place: str) -> Callable[[Scales], list[Block]]:
    def variants(s: Scales) -> list[Block]:
        times = [k * s.period_s for k in (1.0, 0.2, 0.5, 2.0, 5.0, 20.0)]
        return [Block("lag", place, {"tau_s": tau}) for tau in times]

    return variants


FAST = "steps, with the ringing sampled well above its frequency"
PHYSICS = Physics(
    name="lag",
    kinds=(KIND,),
    candidates=_candidates,
    specimens={
        "lag": Specimen(_variants("drive")),
        "sensor-lag": Specimen(
            _variants("sensor"), "record the amplifier's monitor output as a channel as well"
        ),
    },
    distinguished_by={
        "resonance": FAST,
        "slew": "the same fast chirp at a large and at a small stroke",
    },
)
