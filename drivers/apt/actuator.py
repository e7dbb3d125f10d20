"""A Thorlabs piezo driver on its USB serial port (APT protocol), in open loop.

APT does not acknowledge a set. So each write is followed, in the same transfer, by a request for
the output voltage, and the reply must match what was set. The unit reports its set-point in counts,
so the driver knows it exactly from the start.

The voltage limit is read and checked; it is never set, because it changes the value of a count.
"""

import math
import time
from abc import abstractmethod
from collections.abc import Callable
from dataclasses import replace

from dehyst.drivers.apt.channel import AptChannel
from dehyst.drivers.apt.codec import FULL_OUTPUT, VOLTAGE_LIMITS_V
from dehyst.drivers.apt.open_loop import check_ready, enable, reported_counts
from dehyst.drivers.apt.role import AptRole
from dehyst.drivers.apt.settings import PiezoSettings
from dehyst.drivers.call_times import Batches, CallTimes
from dehyst.drivers.interface import DeviceSpec, DriverConfigError, OutOfRange, ProtocolError

BATCHES = Batches()

EXPECTED_S, MOST_HZ = 0.01, 1000.0
"""Assumed duration of a write, and highest rate, until the unit has been timed: a USB frame takes a
millisecond."""

HIGHEST_V = max(VOLTAGE_LIMITS_V.values())

READBACK_COUNTS = 33
"""How far the reported output may be from what was set: 0.1 % of the limit, which allows for
rounding in the unit. A set that was not carried out is off by more, or by too little to matter."""


class AptPiezo(AptRole):
    """One output of a unit of `kind`; a subclass names the kind and reads the voltage limit."""

    def __init__(
        self, settings: PiezoSettings, clock: Callable[[], float] = time.monotonic
    ) -> None:
        super().__init__(settings, clock)
        self._limit_v = float(settings.limit_v or HIGHEST_V)
        self._set_v = math.nan
        self.spec = DeviceSpec(
            unit="v",
            minimum=0.0,
            maximum=settings.max_v or self._limit_v,
            resolution=self._limit_v / FULL_OUTPUT,
            max_rate_hz=MOST_HZ,
            latency_s=EXPECTED_S,
        )

    def open(self) -> None:
        """Connect, identify, check mode, sources and limit, enable the output and time a few sets
        to its present voltage. The output does not move: if disabled, it is enabled at 0 V."""
        channel, settings = self._channel, self.settings
        if channel.is_open:
            return
        channel.connect(self._known)
        with self._closed_on_failure():
            found, identity = channel.identify(self._known)
            self._check_channel(channel)
            check_ready(channel)
            limit_v = self._checked_limit_v(channel)
            maximum_v = settings.max_v or limit_v
            enable(channel)
            counts = reported_counts(channel)
            set_v = counts / FULL_OUTPUT * limit_v
            if not 0.0 <= set_v <= maximum_v:
                raise DriverConfigError(
                    f"{channel.path}: the output is at {set_v:g} V, outside the 0 to "
                    f"{maximum_v:g} V allowed; bring it into that range by hand, or change max_v"
                )
            # the present voltage is set again: a set costs the unit as much as the request for it
            again = channel.encode("pz_set_outputvolts", voltage=counts)
            times = BATCHES.best(lambda: reported_counts(channel, again), self._clock)
        self._limit_v, self._set_v = limit_v, set_v
        self.unit = self._known = found
        self.spec = replace(
            self.spec,
            maximum=maximum_v,
            resolution=limit_v / FULL_OUTPUT,
            identity=f"{identity}{self._more_words()} limit {limit_v:g} V",
        )
        self._update_spec(times)

    def write(self, volts: float) -> None:
        """Set the output, rounded to a count; return when the unit has reported it.

        Raises OutOfRange (nothing written), DeviceTimeout, DeviceGone, and ProtocolError if the
        unit reports another voltage: output() then returns the reported one.
        """
        channel = self._channel
        counts = self._counts(volts)
        set_v = counts / FULL_OUTPUT * self._limit_v
        command = channel.encode("pz_set_outputvolts", voltage=counts)
        found = reported_counts(channel, command)
        if abs(found - counts) > READBACK_COUNTS:
            self._set_v = found / FULL_OUTPUT * self._limit_v
            raise ProtocolError(
                f"{channel.path}: the unit was set to {set_v:g} V but reports {self._set_v:g} V; "
                "check that it is in open loop and that nobody is turning its wheel"
            )
        self._set_v = set_v

    def output(self) -> float:
        """Return the set-point in V that the unit reported last; NaN before open()."""
        return self._set_v

    @abstractmethod
    def _read_limit_v(self, channel: AptChannel) -> float:
        """Return the unit's voltage limit, the value of FULL_OUTPUT. Raises ProtocolError."""

    def _checked_limit_v(self, channel: AptChannel) -> float:
        """Return the unit's voltage limit. Raises DriverConfigError if it is not the configured one
        or is below the configured range."""
        limit_v = self._read_limit_v(channel)
        wanted_v, max_v = self.settings.limit_v, self.settings.max_v
        if wanted_v is not None and limit_v != wanted_v:
            raise DriverConfigError(
                f"{channel.path}: the unit's voltage limit is {limit_v:g} V, but limit_v is "
                f"{wanted_v} V; change the limit on the unit's panel, or limit_v in the settings"
            )
        if max_v is not None and max_v > limit_v:
            raise DriverConfigError(
                f"{channel.path}: max_v is {max_v:g} V, above the unit's voltage limit of "
                f"{limit_v:g} V; lower max_v, or raise the limit on the unit's panel if the stage "
                "can take it"
            )
        return limit_v

    def _counts(self, volts: float) -> int:
        minimum, maximum = self.spec.minimum, self.spec.maximum
        if not minimum <= volts <= maximum:  # NaN included
            raise OutOfRange(
                f"{volts:g} V is outside the {minimum:g} to {maximum:g} V of the "
                f"{self.kind.models[0]}; nothing was written"
            )
        # rounding must not pass the maximum
        return min(
            round(volts / self._limit_v * FULL_OUTPUT),
            math.floor(maximum / self._limit_v * FULL_OUTPUT),
        )

    def _update_spec(self, times: CallTimes) -> None:
        self.spec = replace(
            self.spec,
            max_rate_hz=BATCHES.rate_hz(times),
            latency_s=times.percentile_s(50.0),
            late_s=BATCHES.late_s(times),
        )
