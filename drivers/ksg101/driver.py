"""Driver of the Thorlabs KSG101 / TSG001 strain gauge reader on USB serial (APT protocol)."""

import math
import time
from collections.abc import Callable

from dehyst.drivers.apt.link import AptKind, AptLink
from dehyst.drivers.call_times import Batches, CallTimes
from dehyst.drivers.driver import IdentifiedDriver
from dehyst.drivers.interface import DeviceGone, DeviceSpec, DriverConfigError
from dehyst.drivers.ksg101.settings import Ksg101Settings

KIND = AptKind("ksg101", models=("KSG101", "TSG001"), prefixes=("59", "84"))
FULL_SCALE = 32767
"""Counts of a reading at the full travel of the unit."""
BATCHES = Batches(most=4)  # tests/benchmarks/daemon/deadlines_of_axes.py
EXPECTED_S = 0.01
"""Assumed duration of a reading before the unit has been timed."""


class Ksg101(IdentifiedDriver):
    """Thorlabs KSG101 strain gauge reader on USB serial, in um; NaN at full scale: out of range."""

    settings_type = Ksg101Settings

    def __init__(
        self, settings: Ksg101Settings, clock: Callable[[], float] = time.monotonic
    ) -> None:
        self.settings = settings
        self._clock = clock
        self._link: AptLink | None = None
        self._travel_um = settings.max_travel_um
        self.spec = self._spec()

    def open(self) -> None:
        """Connect, identify, learn the travel, and time a few readings. Moves nothing."""
        self._connect()
        with self._closed_on_failure():
            info = self._identify()
            if not self.settings.max_travel_um:
                self._travel_um = self._ask_travel()
            self.spec = self._spec(info, BATCHES.best(self.read, self._clock))

    def read(self) -> float:
        """Take one reading [um]; NaN when the unit is at full scale.

        Raises DeviceTimeout, DeviceGone or ProtocolError.
        """
        values = self._require_link().ask("tsg_req_reading", "tsg_get_reading", chan=1).values
        counts = int(values["reading"])
        if self.settings.smoothed:  # sent unsigned; negative values wrap
            counts = (int(values["smoothed"]) + 0x8000) % 0x10000 - 0x8000
        if abs(counts) >= FULL_SCALE:
            return math.nan
        return counts / FULL_SCALE * self._travel_um * self.settings.calibration

    def zero(self) -> None:
        """Make the present position the unit's zero. Changes the unit: only on request."""
        self._require_link().send("pz_set_zero", chan=1)

    def reconnect(self) -> None:
        """Open the port again and check that the same unit answers."""
        self.close()
        self._connect()
        with self._closed_on_failure():
            self._identify()

    def close(self) -> None:
        """Close the port. Safe to call twice."""
        if self._link is not None:
            self._link.close()
            self._link = None

    def _spec(self, identity: str = "", times: CallTimes | None = None) -> DeviceSpec:
        latency_s = EXPECTED_S if times is None else times.percentile_s(50.0) or EXPECTED_S
        reach = abs(self._travel_um * self.settings.calibration)
        return DeviceSpec(
            unit="um",
            minimum=-reach,
            maximum=reach,
            resolution=reach / FULL_SCALE,
            max_rate_hz=1.0 / latency_s,
            latency_s=latency_s,
            identity=identity,
            late_s=0.0 if times is None else BATCHES.late_s(times),
        )

    def _connect(self) -> None:
        if self._link is None:
            known = self._known.serial if self._known else None
            path = KIND.find_port(self.settings.port, self.settings.serial_number or known)
            settings = self.settings
            self._link = AptLink(path, settings.timeout_s, settings.rtscts, self._clock)

    def _identify(self) -> str:
        wanted = self.settings.serial_number
        found, words = self._require_link().identify(KIND, wanted, self._known)
        self.unit = self._known = found
        return words

    def _ask_travel(self) -> float:
        travel_um = (
            self._require_link()
            .ask("pz_req_maxtravel", "pz_get_maxtravel", chan=1)
            .values["travel_100nm"]
        )
        if travel_um == 0:
            raise DriverConfigError(
                f"ksg101 at {self.settings.port}: the unit does not know its travel; set "
                "max_travel_um to its travel at 100 %"
            )
        return float(travel_um) / 10.0

    def _require_link(self) -> AptLink:
        if self._link is None:
            raise DeviceGone(f"ksg101 at {self.settings.port} is not open")
        return self._link
