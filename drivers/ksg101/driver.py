"""Thorlabs KSG101 / TSG001 strain gauge reader over its USB serial port (APT protocol).

The FTDI chip holds bytes back for 16 ms unless its latency timer is set to 1 ms (the port does
that where it may; see also the udev rule).
"""

import math
import time
from collections.abc import Callable, Mapping
from typing import Any, Self

from dehyst.drivers.call_times import Batches, CallTimes
from dehyst.drivers.interface import (
    DeviceGone,
    DeviceNotFound,
    DeviceSpec,
    DeviceTimeout,
    DriverConfigError,
    ForeignUnit,
    ProtocolError,
    UnitIdentity,
    refuse_another,
)
from dehyst.drivers.ksg101.codec import AptMessage, Decoder, encode_apt
from dehyst.drivers.ksg101.settings import Ksg101Settings
from dehyst.drivers.serial_port import SerialPort, find_usb_ports, place_of
from dehyst.drivers.settings import read_settings

USB_IDS = ((0x0403, 0xFAF0),)  # FTDI with Thorlabs' product number
FULL_SCALE = 32767
BATCHES = Batches(most=4)  # tests/benchmarks/daemon/deadlines_of_axes.py


class Ksg101:
    """Thorlabs KSG101 strain gauge reader on USB serial, in um; NaN at full scale: out of range."""

    settings_type = Ksg101Settings

    def __init__(
        self, settings: Ksg101Settings, clock: Callable[[], float] = time.monotonic
    ) -> None:
        self.settings = settings
        self._clock = clock
        self._port: SerialPort | None = None
        self._decoder = Decoder()
        self._late = False  # a request timed out: its reply may still come
        self._travel_um = settings.max_travel_um
        self.unit: UnitIdentity | None = None
        self._known: UnitIdentity | None = None
        self.spec = self._spec()

    @classmethod
    def from_settings(cls, settings: Mapping[str, Any]) -> Self:
        """Make a driver; DriverConfigError names a wrong key."""
        return cls(read_settings(cls.settings_type, settings))

    def expect(self, unit: UnitIdentity) -> None:
        """From now on open() and reconnect() raise ForeignUnit where another one answers."""
        self._known = unit

    def open(self) -> None:
        """Connect, identify, learn the travel, and time a few readings. Moves nothing."""
        self._connect()
        try:
            info = self._identify()
            if not self.settings.max_travel_um:
                self._travel_um = self._ask_travel()
            self.spec = self._spec(info, BATCHES.best(self.read, self._clock))
        except BaseException:
            self.close()
            raise

    def read(self) -> float:
        """One reading [um]; NaN when the unit is at full scale.

        Raises DeviceTimeout, DeviceGone or ProtocolError.
        """
        values = self._ask("tsg_req_reading", "tsg_get_reading", chan=1).values
        counts = int(values["reading"])
        if self.settings.smoothed:  # sent unsigned; below zero it wraps
            counts = (int(values["smoothed"]) + 0x8000) % 0x10000 - 0x8000
        if abs(counts) >= FULL_SCALE:
            return math.nan
        return counts / FULL_SCALE * self._travel_um * self.settings.calibration

    def zero(self) -> None:
        """Make the unit's present position its zero. A change of the unit: only when asked."""
        self._require_port().write(encode_apt("pz_set_zero", chan=1))

    def reconnect(self) -> None:
        """Open the port again and see that the same unit answers."""
        self.close()
        self._connect()
        try:
            self._identify()
        except BaseException:
            self.close()
            raise

    def close(self) -> None:
        """Give the port back. Safe to call twice."""
        if self._port is not None:
            self._port.close()
            self._port = None

    def _spec(self, identity: str = "", times: CallTimes | None = None) -> DeviceSpec:
        latency_s = 0.0 if times is None else times.percentile_s(50.0)
        reach = abs(self._travel_um * self.settings.calibration)
        return DeviceSpec(
            unit="um",
            minimum=-reach,
            maximum=reach,
            resolution=reach / FULL_SCALE,
            max_rate_hz=1.0 / latency_s if latency_s > 0 else 100.0,
            latency_s=latency_s or 0.01,
            identity=identity,
            late_s=0.0 if times is None else BATCHES.late_s(times),
        )

    def _connect(self) -> None:
        if self._port is not None:
            return
        path = self.settings.port
        if path == "auto":
            found = find_usb_ports(USB_IDS)
            if len(found) != 1:
                seen = ", ".join(p.path for p in found) or "none"
                raise DeviceNotFound(f"ksg101: port = 'auto' needs one unit on USB, found {seen}")
            path = found[0].path
        self._port = SerialPort(
            path,
            write_timeout_s=self.settings.timeout_s,
            rtscts=self.settings.rtscts,
            clock=self._clock,
        )
        self._late = False
        self._decoder.reset()
        self._port.write(encode_apt("hw_stop_updatemsgs"))
        self._port.read_available()

    def _identify(self) -> str:
        info = self._ask("hw_req_info", "hw_get_info").values
        model = bytes(info["model"]).split(b"\0")[0].decode("ascii", "replace").strip()
        minor, interim, major, _ = bytes(info["firmware"])
        path = self._require_port().path
        number = str(info["serial_number"] or "")
        wanted = self.settings.serial_number
        if wanted is not None and number != wanted:
            raise ForeignUnit(
                f"{path}: the unit has serial number {number!r}, wanted is {wanted!r}"
            )
        found = UnitIdentity(number, model, place_of(path))
        refuse_another(path, found, self._known)
        self.unit = self._known = found
        return f"{model} serial {info['serial_number']} firmware {major}.{interim}.{minor}"

    def _ask_travel(self) -> float:
        travel_um = self._ask("pz_req_maxtravel", "pz_get_maxtravel", chan=1).values["travel_100nm"]
        if travel_um == 0:
            raise DriverConfigError(
                f"ksg101 at {self.settings.port}: the unit does not know its travel; "
                "set max_travel_um to what its 100 % means"
            )
        return float(travel_um) / 10.0

    def _require_port(self) -> SerialPort:
        if self._port is None:
            raise DeviceGone(f"ksg101 at {self.settings.port} is not open")
        return self._port

    def _ask(self, request: str, wanted: str, **values: int) -> AptMessage:
        """Send a request and wait for its reply, past anything else, for timeout_s at most."""
        deadline_s = self._clock() + self.settings.timeout_s
        if self._late and wanted != "hw_get_info":
            # replies carry no number: ask for something else first, so that a late reply is
            # not mistaken for the answer to this request
            self._exchange("hw_req_info", "hw_get_info", deadline_s)
        return self._exchange(request, wanted, deadline_s, **values)

    def _exchange(self, request: str, wanted: str, deadline_s: float, **values: int) -> AptMessage:
        port = self._require_port()
        port.write(encode_apt(request, **values))
        skipped = self._decoder.skipped
        while True:
            data = port.read_until_deadline(deadline_s)
            for message in self._decoder.feed(data):
                if message.name == wanted:
                    self._late = False
                    return message
                if message.name in ("hw_response", "hw_richresponse"):
                    raise ProtocolError(
                        f"{port.path}: the unit refuses {request}: {message.values}"
                    )
            if not data:
                self._decoder.reset()
                self._late = True
                strange = self._decoder.skipped - skipped
                raise DeviceTimeout(
                    f"{port.path}: no answer to {request} within {self.settings.timeout_s:g} s"
                    + (f" ({strange} bytes that are no APT message came)" if strange else "")
                )
