"""Creep of a move before the recording: y = x + amount log10(1 + t / since).

The last move before the recording ended `since` before the first sample; t is the time from that
sample. Log-type creep of that move (Jung and Gweon 2000) continues through the recording,
independent of its drive. It belongs to one recording and is forward only, since every recording has
a different past.

A stage that creeps after one move also creeps after the recorded ones. A warm-up resembles the
creep of one move, but the recorded moves then do not creep.
"""

import math
from collections.abc import Mapping, Sequence

import numpy as np

from dehyst.models.model import Block
from dehyst.models.physics.address import Kernel, fields, record
from dehyst.models.physics.candidate import (
    Candidate,
    Context,
    Parameter,
    common_amplitude,
    format_length,
    move_from_zero,
    one_per_recording,
    split_by_recording,
)
from dehyst.models.physics.entry import Physics, Scales, Specimen
from dehyst.models.physics.kind import Kind, Never, Param
from dehyst.models.signals.joined import Data, Floats

PACKED = fields("amount", "since")
STATE = fields("elapsed")  # time since the first sample
MOST = 0.5  # largest creep per decade, of the stroke: the move may have been larger than that
MOST_OF_REACH = 0.1  # the same, of the displacement of a move from drive 0; the larger one counts
MOST_MOVE = 4.0
"""Size of the earlier move that the creep after the recorded ones may imply, in moves from drive 0.
The loop takes part of the latter creep, and its fit is up to 3 times too small."""
EARLIEST, LATEST = 0.002, 3.0  # range of `since`, relative to the recording's length


@Kernel
def step(
    p_at: int, n_p: int, s_at: int, n_s: int, x: float, t: float, dt: float, ch: float
) -> float:
    """Forward."""
    p, s = record(p_at, PACKED), record(s_at, STATE)
    s.elapsed += dt
    return x + p.amount * math.log10(1.0 + s.elapsed / p.since)


KIND = Kind(
    name="earlier_creep",
    says="creep of a move before the recording",
    places=("stage", "sensor"),
    params=(
        Param("amount_{y}", "amount", "", -1e9, 1e9, "per decade of time"),
        Param("since_s", "since", "s", 1e-9, 1e9, "from the last move to the first sample"),
    ),
    packed=PACKED,
    state=STATE,
    step=step,
    inverse=Never("it belongs to one recording", of_one_recording=True),
)


class EarlierCreep(Candidate):
    """y + a log10(1 + t / since), with a separate a and since for each recording. Typical: 1 to 2 %
    of that move per decade of time; shown by the first seconds of a recording that begins after a
    move."""

    name = "creep"
    key = "creep-earlier"
    title = "Creep from before the recording"
    equation = "y(t) = f(u) + a log10(1 + t / since)"
    source = "the move that ended shortly before the recording began"
    confused_with = ("drift",)
    order = 56
    driven = False
    slow = past = True
    minima = 3

    def __init__(self, data: Data) -> None:
        self._unit = data.unit
        self._longest = float(data.t.max() - data.t.min())
        low, high = EARLIEST * self._longest, LATEST * self._longest
        since = Parameter("since_s", "s", max(low, 4 * data.period), high)
        self.parameters = one_per_recording(data, since)

    def starts(self, data: Data, residual: Floats) -> list[tuple[float, ...]]:
        p = self.parameters[0]
        within = [min(max(f * self._longest, 1.1 * p.low), 0.9 * p.high) for f in (0.01, 0.05, 0.3)]
        return [(since,) * len(self.parameters) for since in within]

    def columns(self, data: Data, context: Context, theta: Sequence[float]) -> Floats:
        first = np.array([data.t[np.argmax(data.rec == i)] for i in range(len(data.names))])
        since = np.array(theta)
        return split_by_recording(
            data, np.log10(1.0 + (data.t - first[data.rec]) / since[data.rec])
        )

    def values(self, theta: Sequence[float], amplitudes: Floats) -> dict[str, tuple[float, str]]:
        largest = int(np.argmax(np.abs(amplitudes)))
        return {
            "since_s": (float(theta[largest]), "s"),
            "per_decade_um": (float(amplitudes[largest]), self._unit),
        }

    def blocks(self, theta: Sequence[float], amplitudes: Floats, data: Data) -> tuple[Block, ...]:
        # a model has one past: that of the recording with the largest amplitude
        since, context = theta[int(np.argmax(np.abs(amplitudes)))], Context(data.u, data.y)
        one = self.columns(data, context, (since,) * len(theta))
        added = self.columns(data, context, theta) @ amplitudes
        params: dict[str, float | tuple[float, ...]] = {
            f"amount_{data.unit}": common_amplitude(data, one, added),
            "since_s": float(since),
        }
        return (Block("earlier_creep", "stage", params),)

    def describe(self, values: Mapping[str, tuple[float, str]]) -> str:
        return (
            "The stage is still creeping from a move that ended about "
            f"{values['since_s'][0]:.2g} s before the recording began, by "
            f"{format_length(values['per_decade_um'])} per decade of time: wait before "
            "recording, or record the move as well."
        )

    def required_companion(self) -> str:
        return "creep"

    def implausible_with(self, amplitudes: Floats, companion: Sequence[float], data: Data) -> str:
        gain_per_decade = companion[0] if companion else 0.0
        most = MOST_MOVE * max(float(np.ptp(data.y)), move_from_zero(data))
        if float(np.abs(amplitudes).max()) > gain_per_decade * most:
            return "no recorded move creeps as that of an earlier one would imply"
        return ""

    def implausible(self, theta: Sequence[float], amplitudes: Floats, data: Data) -> str:
        most = max(MOST * float(np.ptp(data.y)), MOST_OF_REACH * move_from_zero(data))
        if float(np.abs(amplitudes).max()) > most:
            return "creep of more than half of the stroke"
        return ""


def _variants(s: Scales) -> list[Block]:
    size = {f"amount_{s.unit}": 0.01 * s.stroke}
    return [
        Block("earlier_creep", "stage", {**size, "since_s": k * s.seconds})
        for k in (0.03, 0.01, 0.1)
    ]


PHYSICS = Physics(
    name="creep",
    kinds=(KIND,),
    candidates=lambda data: [EarlierCreep(data)],
    specimens={"earlier-creep": Specimen(_variants, "begin the recording right after a move")},
)
