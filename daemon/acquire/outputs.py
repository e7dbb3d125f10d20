"""The outputs that a recording drives: their ramps, and their return when it ends."""

import math
from collections.abc import Sequence
from typing import Any

from dehyst.daemon import clock
from dehyst.daemon.config import Config
from dehyst.daemon.files.known_units import ACTUATOR, open_known
from dehyst.daemon.loop.checks import note_output, past_output
from dehyst.daemon.loop.devices import DeviceLink
from dehyst.drivers.interface import DriverError

BACK_S, POLL_S = 5.0, 0.05
"""Longest wait for an amplifier's link to come back before the return is given up, and the time
between two looks at it. A reconnection that succeeds takes 0.2 to 3 s (loop/devices.py)."""
ROUNDING = 1e-6
"""Share by which a step may exceed the largest one: a drive at the slew limit exceeds it by the
rounding of its times, up to 1e-9, and is played as it is."""


def toward(at: float, goal: float, most: float) -> float:
    """Return the goal, or the value nearest to it that is a step of `most` away from `at`."""
    way = goal - at
    return goal if abs(way) <= most * (1.0 + ROUNDING) else at + math.copysign(most, way)


class DrivenOutput:
    """The output of one axis. at_v: the last written voltage; before the first write the voltage
    at which the output was found, which start_v keeps."""

    def __init__(self, config: Config, actuator: Any) -> None:
        self.config = config
        self.link = DeviceLink("actuator", actuator)
        self.start_v = self.at_v = math.nan

    def open(self) -> None:
        """Open the device. Moves nothing."""
        open_known(self.config, ACTUATOR, self.link.device)

    def find_start(self) -> None:
        """Find out where the output is."""
        device = self.link.device
        self.start_v = float(past_output(self.config, float(device.output()), device)[0][-1])
        self.at_v = self.start_v

    def write(self, volts: float) -> None:
        """Set the output."""
        self.link.call(self.link.device.write, volts)
        self.at_v = volts

    def ramp(self, goal_v: float) -> None:
        """Ramp the output at the configured rate at most."""
        device, period_s = self.link.device, 1.0 / self.config.loop.rate_hz
        # a unit that cannot report its output returns a setting until it is written
        at_v = float(self.link.call(device.output)) if device.spec.output_known else self.at_v
        while at_v != goal_v:
            at_v = toward(at_v, goal_v, self.config.safe.ramp_v_per_s * period_s)
            self.write(at_v)
            clock.sleep_s(period_s)

    def note(self) -> None:
        """Record the output voltage for the next program if the unit cannot report it."""
        if not self.link.device.spec.output_known and math.isfinite(self.at_v):
            note_output(self.config, self.at_v)

    def is_returned(self) -> bool:
        """Ramp the output to start_v; return False if its link is down."""
        if not (self.link.ok or self.link.came_back()):
            return False
        try:
            self.ramp(self.start_v)
        except DriverError:
            return False
        return True


def return_all(outputs: Sequence[DrivenOutput], ended: str) -> None:
    """Ramp the outputs back to where they started, one after the other, each as soon as its link is
    up: one late reply takes a link down for a moment. ended: why the recording ended early, "" if
    it did not. Raises DriverError, with `ended` in its words, if one does not come back."""
    left = list(outputs)
    try:
        for _ in range(round(BACK_S / POLL_S)):
            left = [output for output in left if not output.is_returned()]
            if not left:
                return
            clock.sleep_s(POLL_S)
    finally:
        for output in outputs:
            output.note()
    said = [ended or left[0].link.news[-1]]
    for output in left:
        of = f" of axis {output.config.axis}" if output.config.axis else ""
        said.append(f"the output{of} could not be returned and stays at about {output.at_v:.1f} V")
    raise DriverError("; ".join(said))
