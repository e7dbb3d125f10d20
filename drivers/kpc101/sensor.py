"""The strain gauge of a Thorlabs KPC101, BPC301 or BPC303 channel (APT protocol), in micrometres.

The position comes from the unit's status, which is measured in open loop as well. (PZ_REQ_OUTPUTPOS
reports a position for the closed loop only.)
"""

import math
import time
from collections.abc import Callable
from typing import Any, ClassVar

from dehyst.drivers.apt.codec import FULL_TRAVEL, GAUGE_CONNECTED
from dehyst.drivers.apt.role import AptRole
from dehyst.drivers.call_times import Batches, CallTimes
from dehyst.drivers.interface import DeviceSpec, DriverConfigError
from dehyst.drivers.kpc101.kinds import ONE_CHANNEL, OneOfThree
from dehyst.drivers.kpc101.settings import Bpc303SensorSettings, Kpc101SensorSettings

BATCHES = Batches(most=4)  # as for the KSG101

EXPECTED_S = 0.01
"""Assumed duration of a reading before the unit has been timed."""


class Kpc101Sensor(AptRole):
    """Strain gauge of a Thorlabs KPC101 or BPC301, in um; NaN at full scale or without a gauge."""

    kind = ONE_CHANNEL
    settings_type: ClassVar[type[Kpc101SensorSettings]] = Kpc101SensorSettings
    settings: Kpc101SensorSettings

    def __init__(
        self, settings: Kpc101SensorSettings, clock: Callable[[], float] = time.monotonic
    ) -> None:
        super().__init__(settings, clock)
        self._travel_um = settings.max_travel_um
        self.spec = self._spec()

    def open(self) -> None:
        """Connect, identify, check for a gauge, learn its travel, time some readings. No motion."""
        if self._channel.is_open:
            return
        words = self._connect()
        with self._closed_on_failure():
            self._check_gauge()
            self._travel_um = self.settings.max_travel_um or self._ask_travel()
            self.spec = self._spec(words, BATCHES.best(self.read, self._clock))

    def read(self) -> float:
        """Take one reading [um]; NaN at full scale, and while no gauge is connected.

        Raises DeviceTimeout, DeviceGone or ProtocolError.
        """
        status = self._status()
        counts = int(status["position"])
        if abs(counts) >= FULL_TRAVEL or not status["status"] & GAUGE_CONNECTED:
            return math.nan
        return counts / FULL_TRAVEL * self._travel_um

    def reconnect(self) -> None:
        """Open the port again and check that the same unit answers."""
        self.close()
        self._connect()

    def _connect(self) -> str:
        self._channel.connect(self._known)
        with self._closed_on_failure():
            self.unit, words = self._channel.identify(self._known)
            self._check_channel(self._channel)
        self._known = self.unit
        return f"{words}{self._more_words()} gauge"

    def _status(self) -> dict[str, Any]:
        return self._channel.ask("pz_req_pzstatusupdate", "pz_get_pzstatusupdate").values

    def _check_gauge(self) -> None:
        if not self._status()["status"] & GAUGE_CONNECTED:
            raise DriverConfigError(
                f"{self._channel.path}: no strain gauge is connected to channel {self.number}; "
                "connect one, or choose another sensor"
            )

    def _ask_travel(self) -> float:
        reply = self._channel.ask("pz_req_maxtravel", "pz_get_maxtravel")
        travel_um = reply.values["travel_100nm"] / 10.0
        if travel_um == 0.0:
            raise DriverConfigError(
                f"{self._channel.path}: the unit does not know its travel; set max_travel_um to "
                "its travel at 100 %"
            )
        return float(travel_um)

    def _spec(self, identity: str = "", times: CallTimes | None = None) -> DeviceSpec:
        reach_um = self._travel_um or 1.0  # unknown until it is open
        latency_s = EXPECTED_S if times is None else times.percentile_s(50.0)
        return DeviceSpec(
            unit="um",
            minimum=-reach_um,
            maximum=reach_um,
            resolution=reach_um / FULL_TRAVEL,
            max_rate_hz=1.0 / latency_s,
            latency_s=latency_s,
            identity=identity,
            late_s=0.0 if times is None else BATCHES.late_s(times),
        )


class Bpc303Sensor(OneOfThree, Kpc101Sensor):
    """Strain gauge of one channel of a Thorlabs BPC303, in um; NaN at full scale or without one."""

    settings_type = Bpc303SensorSettings
    settings: Bpc303SensorSettings
