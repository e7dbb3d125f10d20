"""A digital-to-analog converter under Linux IIO, into the amplifier's analog input.

Voltage at the piezo = gain x volts at the converter, plus the voltage set by knob or USB, which
this driver cannot know: set it to 0. The output's present counts are read back when the channel is
opened. A converter that is powered down must be woken first (out_voltage0_powerdown). Tested on
real files laid out like sysfs, not on a converter.
"""

import math
from typing import TYPE_CHECKING

import numpy as np

from dehyst.drivers.driver import Driver, found_outside, out_of_range
from dehyst.drivers.iio.channel import Channel, count_range
from dehyst.drivers.iio.settings import IioActuatorSettings
from dehyst.drivers.interface import DeviceNotFound, DeviceSpec, DriverConfigError

if TYPE_CHECKING:  # the compiled functions are imported only where they are needed
    from dehyst.drivers.direct_calls import Direct

LATENCY_S = 1e-4  # assumed duration of a write over SPI; it is not measured
HAIR = 1e-6  # of a count: a range limit that falls on a count includes it


class IioActuator(Driver):
    """A converter channel as a voltage source; volts here are volts at the piezo."""

    settings_type = IioActuatorSettings

    def __init__(self, settings: IioActuatorSettings) -> None:
        self.settings = settings
        self._channel = Channel(settings.path, "out", settings.channel)
        context = self._channel.context
        context["scale_mv"], context["gain"] = 1.0, settings.gain
        context["minimum_v"], context["maximum_v"] = settings.min_v, settings.max_v
        context["output_v"] = math.nan
        self.spec = self._spec("")

    def open(self) -> None:
        """Find the channel, its scale and offset, and the present output. Moves nothing."""
        channel = self._channel
        if channel.is_open:
            return
        channel.open()
        with self._closed_on_failure():
            self._learn()
        self.spec = self._spec(channel.identity())

    def write(self, volts: float) -> None:
        """Set the voltage at the piezo, to the nearest count within the range.

        Raises OutOfRange, DeviceTimeout, DeviceGone, or ProtocolError when the kernel refuses it.
        """
        c = self._channel.context[0]
        if self._channel.is_open and not c["minimum_v"] <= volts <= c["maximum_v"]:
            who = f"iio: {self._channel.file}"
            raise out_of_range(who, volts, self.spec.minimum, self.spec.maximum)
        exact = np.rint(self._exact_counts(volts))
        self._channel.write_counts(int(min(max(exact, c["low"]), c["high"])))
        c["output_v"] = volts

    def output(self) -> float:
        """Return the last written voltage at the piezo, or the one found by open()."""
        return float(self._channel.context["output_v"][0])

    def direct(self) -> "Direct":
        """Return the C function that writes."""
        from dehyst.drivers.iio import direct_calls

        return direct_calls.actuator(self._channel)

    def close(self) -> None:
        """Release the channel; the output stays where it is. Safe to call twice."""
        self._channel.close()

    def _learn(self) -> None:
        channel, settings = self._channel, self.settings
        c = channel.context[0]
        scale_mv = channel.attribute("scale")
        if scale_mv is None or not 0.0 < scale_mv < math.inf:
            raise DeviceNotFound(
                f"iio: {channel.file} has no scale above 0 next to it, so the size of a count is "
                "not known"
            )
        c["scale_mv"], c["offset"] = scale_mv, channel.attribute("offset") or 0.0
        low, high = count_range(settings.bits, settings.unsigned)
        c["low"] = math.ceil(self._exact_counts(settings.min_v) - HAIR)
        c["high"] = math.floor(self._exact_counts(settings.max_v) + HAIR)
        if not low <= c["low"] < c["high"] <= high:
            raise DriverConfigError(
                f"iio: min_v = {settings.min_v:g} to max_v = {settings.max_v:g} is not within the "
                f"{self._volts(low):g} to {self._volts(high):g} V that {channel.file} reaches at "
                f"gain {settings.gain:g} and {settings.bits} bits"
            )
        stands_v = self._volts(channel.read_counts())
        half_v = self._volts(1) / 2.0 - self._volts(0) / 2.0
        if not settings.min_v - half_v <= stands_v <= settings.max_v + half_v:
            raise found_outside("iio", stands_v, settings.min_v, settings.max_v)
        if not abs(stands_v - c["output_v"]) <= half_v * (1 + HAIR):  # off by more than a count
            c["output_v"] = min(max(stands_v, settings.min_v), settings.max_v)

    def _exact_counts(self, volts: float) -> float:
        c = self._channel.context[0]
        return float(volts / c["gain"] * 1000.0 / c["scale_mv"] - c["offset"])

    def _volts(self, counts: int) -> float:
        c = self._channel.context[0]
        return float((counts + c["offset"]) * c["scale_mv"] / 1000.0 * c["gain"])

    def _spec(self, identity: str) -> DeviceSpec:
        settings = self.settings
        return DeviceSpec(
            unit="v",
            minimum=settings.min_v,
            maximum=settings.max_v,
            resolution=self._volts(1) - self._volts(0),
            max_rate_hz=settings.max_rate_hz,
            latency_s=LATENCY_S,
            identity=f"{identity} at gain {settings.gain:g}" if identity else "",
        )
