"""One linear dynamic element identified together with a hysteresis: its blocks and its wording.

    drive    v = u + tau du/dt (lead), v(t) = u(t - tau) (delay), tau dv/dt + v = u (lag)
    sensor   a lag of first order, or a well-damped one of second order, on the displacement

A lead of a fraction of a sample represents a recorder that reads late, or a stage whose rate is the
derivative and not the difference from the previous sample. Dynamics after the hysteresis are
attributed to the sensor and are never compensated: one recording of drive and reading cannot
distinguish a filter in the sensor from a servo around the stage.
"""

import math
from dataclasses import dataclass

from dehyst.models.model import Block

LEAD, DELAY, LAG, SECOND = "lead", "delay", "lag", "second"


@dataclass(frozen=True)
class Dynamics:
    """kind: LEAD, DELAY, LAG or SECOND; place: "drive" or "sensor"; theta: (tau,) in seconds, or
    (frequency in Hz, damping); held: the input of a lag is held (`kind.HELD`), not a line; late_s:
    delay of this input [s], a sampling period if it is held from a sample on, or 0 if it is held
    since the sample before."""

    kind: str
    place: str
    theta: tuple[float, ...]
    held: bool = False
    late_s: float = 0.0

    @property
    def blocks(self) -> tuple[Block, ...]:
        """The blocks for the model file."""
        late = (Block(DELAY, self.place, {"delay_s": self.late_s}),) if self.late_s else ()
        held = {"held": 1.0} if self.held else {}
        if self.kind == SECOND:
            frequency, damping = self.theta
            numbers = {"frequency_hz": frequency, "damping": damping, "share": 1.0}
            return (*late, Block("resonance", self.place, {**numbers, **held}))
        key = "delay_s" if self.kind == DELAY else "tau_s"
        return (*late, Block(self.kind, self.place, {key: self.theta[0], **held}))

    @property
    def name(self) -> str:
        """Description in words, for the user."""
        where = "of the drive" if self.place == "drive" else "of the sensor"
        if self.kind == SECOND:
            frequency, damping = self.theta
            what = f"second-order lag {where}, {frequency:.3g} Hz, damping {damping:.2g}"
        else:
            what = f"{self.kind} {where}, {1e3 * self.theta[0]:.3g} ms"
        since = "from each sample on" if self.late_s else "since the sample before"
        return f"{what}, input held {since}" if self.held else what

    @property
    def doubt(self) -> str:
        """Sentence for a recording that cannot distinguish it from dynamics of the sensor."""
        what = f"{self.name}: this recording cannot show whether the drive or the sensor causes it"
        taken = "it is attributed to the drive and compensated"
        if self.kind == DELAY:
            return f"{what}, as a delay is the same before and after the hysteresis; {taken}"
        return (
            f"{what}; {taken}. A drive over the full range, of changing size and at up to "
            f"{0.05 / self.theta[0]:.2g} Hz, distinguishes them"
        )

    @property
    def delay_s(self) -> float:
        """Delay of a slow move [s]; negative for a lead."""
        if self.kind == SECOND:
            return self.late_s + self.theta[1] / (math.pi * self.theta[0])
        return -self.theta[0] if self.kind == LEAD else self.late_s + self.theta[0]

    @property
    def short(self) -> bool:
        """Whether it is a mere shift in time. Narrow operators may then be free; with a lag they
        must not be, since they would imitate it."""
        return self.kind in (LEAD, DELAY)

    @property
    def sided(self) -> bool:
        """Whether its effect before the hysteresis differs from that after it."""
        return self.kind != DELAY
