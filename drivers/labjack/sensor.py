"""LabJack: voltage input from a monitor, a capacitive probe or an interferometer, in micrometres.

A reading is the mean of `average` samples, obtained in one exchange. The unit oversamples each by
its `resolution_index`. Both delay the reading by half the time that they take.
"""

import math
import time
from collections.abc import Callable
from typing import TYPE_CHECKING

import numpy as np

from dehyst.drivers.interface import DeviceSpec
from dehyst.drivers.labjack.channel import EXPECTED_S, MOST_HZ, Channel
from dehyst.drivers.labjack.settings import LabjackSensorSettings

if TYPE_CHECKING:  # the compiled functions are imported only where they are needed
    from dehyst.drivers.direct_calls import Direct

GROUND = 199.0  # AIN#_NEGATIVE_CH of a single-ended input


class LabjackSensor(Channel):
    """Analog input of a LabJack T7, T4 or T8 in micrometres."""

    settings_type = LabjackSensorSettings

    def __init__(
        self, settings: LabjackSensorSettings, clock: Callable[[], float] = time.monotonic
    ) -> None:
        super().__init__(settings, settings.channel, clock)
        self.settings = settings
        c = self._context
        c["gain"], c["zero"] = settings.um_per_v, settings.zero_v
        c["minimum"], c["maximum"] = settings.min_v, settings.max_v
        c["count"] = settings.average
        self._names = np.full(settings.average, self._name.ctypes.data, np.int64)
        self._room = np.zeros(settings.average + 1)
        c["name"], c["samples"] = self._names.ctypes.data, self._room.ctypes.data
        ends = sorted(
            (volts - settings.zero_v) * settings.um_per_v
            for volts in (settings.min_v, settings.max_v)
        )
        step_v = 2.0 * settings.range_v / 2**settings.resolution_bits
        self.spec = DeviceSpec(
            unit="um",
            minimum=ends[0],
            maximum=ends[1],
            resolution=step_v * abs(settings.um_per_v),
            max_rate_hz=settings.max_rate_hz or MOST_HZ,
            latency_s=EXPECTED_S,
        )

    def read(self) -> float:
        """Take one reading [um]; NaN if a sample is out of range. Raises DeviceTimeout,
        DeviceGone."""
        ljm, settings, total = self._ready(), self.settings, 0.0
        try:
            samples = ljm.eReadNames(
                self._handle, settings.average, [self.channel] * settings.average
            )
        except ljm.LJMError as error:
            raise self._failed(error) from None
        for sample in samples:
            if not settings.min_v <= sample <= settings.max_v:
                return math.nan
            total += sample
        return (total / settings.average - settings.zero_v) * settings.um_per_v

    def direct(self) -> "Direct | None":
        """Return the C function that reads; None without the C library."""
        from dehyst.drivers.labjack import direct_calls

        return direct_calls.sensor(self.channel, self._context, self._ljm)

    def _more_words(self) -> str:
        mean = self.settings.average
        return f", mean of {mean}" if mean > 1 else ""

    def _prepare(self) -> None:
        """Set up the input: these registers move no output."""
        settings = self.settings
        other = GROUND if settings.negative == "GND" else float(settings.negative[3:])
        for name, value in (
            ("RANGE", settings.range_v),
            ("NEGATIVE_CH", other),
            ("RESOLUTION_INDEX", float(settings.resolution_index)),
            ("SETTLING_US", 1e6 * settings.settling_s),
        ):
            self._ljm.eWriteName(self._handle, f"{self.channel}_{name}", value)

    def _timed_call(self) -> object:
        return self.read()
