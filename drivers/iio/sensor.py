"""A bridge converter under Linux IIO: an AD7124 or AD719x on a single-board computer.

Tested on real files laid out like sysfs, not on a converter.
"""

import math
import time
from collections.abc import Callable
from typing import TYPE_CHECKING

from dehyst.drivers.call_times import typical_s
from dehyst.drivers.driver import Driver
from dehyst.drivers.iio.channel import Channel, count_range
from dehyst.drivers.iio.settings import IioSensorSettings
from dehyst.drivers.interface import DeviceSpec

if TYPE_CHECKING:  # the compiled functions are imported only where they are needed
    from dehyst.drivers.direct_calls import Direct


EXPECTED_S = 0.01
"""Assumed duration of a reading before the channel has been timed."""


class IioSensor(Driver):
    """A converter channel as a displacement sensor, in micrometres."""

    settings_type = IioSensorSettings

    def __init__(
        self, settings: IioSensorSettings, clock: Callable[[], float] = time.monotonic
    ) -> None:
        self.settings = settings
        self._clock = clock
        self._channel = Channel(settings.path, "in", settings.channel)
        context = self._channel.context
        context["scale_mv"], context["gain"] = 1.0, settings.um_per_mv
        context["zero_mv"] = settings.zero_mv
        context["low"], context["high"] = count_range(settings.bits, settings.unsigned)
        self.spec = self._spec("", 0.0)

    def open(self) -> None:
        """Find the channel, its scale and offset, and time a few readings."""
        channel = self._channel
        if channel.is_open:
            return
        channel.open()
        with self._closed_on_failure():
            for name, default in (("scale", 1.0), ("offset", 0.0)):
                found = channel.attribute(name)
                place = "scale_mv" if name == "scale" else name
                channel.context[place] = default if found is None else found
            latency_s = typical_s(self.read, self._clock)
        self.spec = self._spec(channel.identity(), latency_s)

    def read(self) -> float:
        """Run one conversion [um]; NaN if the converter is at an end of its range.

        Raises DeviceTimeout, DeviceGone or ProtocolError.
        """
        counts = self._channel.read_counts()
        c = self._channel.context[0]
        return self._displacement_um(counts) if c["low"] < counts < c["high"] else math.nan

    def direct(self) -> "Direct":
        """Return the C function that reads."""
        from dehyst.drivers.iio import direct_calls

        return direct_calls.sensor(self._channel)

    def close(self) -> None:
        """Release the channel. Safe to call twice."""
        self._channel.close()

    def _displacement_um(self, counts: int) -> float:
        c = self._channel.context[0]
        return float(((counts + c["offset"]) * c["scale_mv"] - c["zero_mv"]) * c["gain"])

    def _spec(self, identity: str, latency_s: float) -> DeviceSpec:
        c = self._channel.context[0]
        ends = sorted(self._displacement_um(int(c[end])) for end in ("low", "high"))
        return DeviceSpec(
            unit="um",
            minimum=ends[0],
            maximum=ends[1],
            resolution=float(abs(c["scale_mv"] * c["gain"])),
            max_rate_hz=1.0 / (latency_s or EXPECTED_S),
            latency_s=latency_s or EXPECTED_S,
            identity=identity,
        )
