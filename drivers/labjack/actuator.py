"""LabJack: an analog output into the amplifier's EXT input.

Voltage at the piezo = gain x (EXT volts - zero_v), plus the voltage set by knob or USB, which this
driver cannot know: set it to 0. A T7's own outputs reach 5 V, half of EXT's range; an LJTick-DAC
(TDAC) covers -10 to 10 V.
"""

import math
import time
from collections.abc import Callable
from typing import TYPE_CHECKING

from dehyst.drivers.driver import found_outside, out_of_range
from dehyst.drivers.interface import DeviceSpec
from dehyst.drivers.labjack.channel import EXPECTED_S, MOST_HZ, Channel
from dehyst.drivers.labjack.settings import LabjackActuatorSettings

if TYPE_CHECKING:  # the compiled functions are imported only where they are needed
    from dehyst.drivers.direct_calls import Direct


class LabjackActuator(Channel):
    """Analog output of a LabJack T7, T4 or T8 into EXT; volts are volts at the piezo."""

    settings_type = LabjackActuatorSettings

    def __init__(
        self, settings: LabjackActuatorSettings, clock: Callable[[], float] = time.monotonic
    ) -> None:
        super().__init__(settings, settings.channel, clock)
        self.settings = settings
        c = self._context
        c["gain"], c["zero"] = settings.gain, settings.zero_v
        c["minimum"], c["maximum"] = settings.min_v, settings.max_v
        c["output_v"] = math.nan if settings.initial_v is None else settings.initial_v
        span_v = settings.device_max_v - settings.device_min_v
        self.spec = DeviceSpec(
            unit="v",
            minimum=settings.min_v,
            maximum=settings.max_v,
            resolution=span_v / 2**settings.resolution_bits * abs(settings.gain),
            max_rate_hz=settings.max_rate_hz or MOST_HZ,
            latency_s=EXPECTED_S,
            output_known=settings.reports,
        )

    def write(self, volts: float) -> None:
        """Set the voltage at the piezo [V]. Raises OutOfRange, DeviceTimeout, DeviceGone."""
        ljm, settings = self._ready(), self.settings
        if not settings.min_v <= volts <= settings.max_v:  # NaN included
            raise out_of_range(f"labjack {self.channel}", volts, settings.min_v, settings.max_v)
        try:
            device_v = volts / settings.gain + settings.zero_v
            ljm.eWriteName(self._handle, self.channel, device_v)
        except ljm.LJMError as error:
            raise self._failed(error) from None
        self._context["output_v"] = volts

    def output(self) -> float:
        """Return the last written voltage at the piezo, or what the unit reported, or initial_v."""
        return float(self._context["output_v"][0])

    def direct(self) -> "Direct | None":
        """Return the C function that writes; None without the C library."""
        from dehyst.drivers.labjack import direct_calls

        return direct_calls.actuator(self.channel, self._context, self._ljm)

    def _more_words(self) -> str:
        return f" into EXT, gain {self.settings.gain:g}"

    def _prepare(self) -> None:
        settings = self.settings
        if not settings.reports:
            return
        reported_v = self._ljm.eReadName(self._handle, self.channel)
        stands_v = (reported_v - settings.zero_v) * settings.gain
        half_v = self.spec.resolution / 2.0
        if not settings.min_v - half_v <= stands_v <= settings.max_v + half_v:
            who = f"labjack {self.channel}"
            raise found_outside(who, stands_v, settings.min_v, settings.max_v)
        if not abs(stands_v - self.output()) <= half_v:  # off by more than the last write's step
            self._context["output_v"] = min(max(stands_v, settings.min_v), settings.max_v)

    def _timed_call(self) -> object:
        register = self.channel if self.settings.reports else "SERIAL_NUMBER"
        return self._ljm.eReadName(self._handle, register)
