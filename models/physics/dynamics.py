"""One piece of linear dynamics, as it is identified with a hysteresis: its block, its words.

    drive    v = u + tau du/dt (lead), v(t) = u(t - tau) (delay), tau dv/dt + v = u (lag)
    sensor   a lag of first order, or a well-damped one of second order, on the displacement

A lead of a part of a sample is a convention: of a recorder that reads late, or of a stage whose
rate is the derivative and not the difference to the sample before. What stands behind the
hysteresis is taken to belong to the sensor and is never compensated; one recording of drive and
reading cannot tell a filter in the sensor from a servo around the stage.
"""

import math
from dataclasses import dataclass

from dehyst.models.model import Block

LEAD, DELAY, LAG, SECOND = "lead", "delay", "lag", "second"


@dataclass(frozen=True)
class Dynamics:
    """kind: LEAD, DELAY, LAG or SECOND; place: "drive" or "sensor"; theta: (tau,) in seconds, or
    (frequency in Hz, damping)."""

    kind: str
    place: str
    theta: tuple[float, ...]

    @property
    def block(self) -> Block:
        """The block of the model file."""
        if self.kind == SECOND:
            frequency, damping = self.theta
            numbers = {"frequency_hz": frequency, "damping": damping, "share": 1.0}
            return Block("resonance", self.place, dict(numbers))
        key = "delay_s" if self.kind == DELAY else "tau_s"
        return Block(self.kind, self.place, {key: self.theta[0]})

    @property
    def name(self) -> str:
        """In words, for people."""
        where = "of the drive" if self.place == "drive" else "of the sensor"
        if self.kind == SECOND:
            frequency, damping = self.theta
            return f"lag of second order {where}, {frequency:.3g} Hz, damping {damping:.2g}"
        return f"{self.kind} {where}, {1e3 * self.theta[0]:.3g} ms"

    @property
    def doubt(self) -> str:
        """What is to be said where this recording does not tell it from one of the sensor."""
        what = f"{self.name}: drive or sensor cannot be distinguished in this recording"
        taken = "it is attributed to the drive and compensated"
        if self.kind == DELAY:
            return f"{what}, as a delay is the same before and after the hysteresis; {taken}"
        return (
            f"{what}; {taken}. A drive over the full range, of changing size and at up to "
            f"{0.05 / self.theta[0]:.2g} Hz, distinguishes them"
        )

    @property
    def delay_s(self) -> float:
        """By how much a slow move comes late [s]."""
        if self.kind == SECOND:
            return self.theta[1] / (math.pi * self.theta[0])
        return -self.theta[0] if self.kind == LEAD else self.theta[0]

    @property
    def short(self) -> bool:
        """A shift in time, beside which narrow operators may be free; what they would imitate of a
        lag they must not."""
        return self.kind in (LEAD, DELAY)

    @property
    def sided(self) -> bool:
        """Whether it is another before the hysteresis than behind it."""
        return self.kind != DELAY
