"""Thorlabs KPZ101 / TPZ001 piezo driver over its USB serial port (APT protocol), open loop.

APT does not acknowledge a set. So each write is followed, in the same transfer, by a request for
the output voltage, and the reply must be what was set. The unit reports its set-point in counts,
so that the driver knows it exactly from the start.

The loop mode, the input sources and the voltage limit are read and checked; they are never set,
because each of them moves the output or changes what a count is worth.
"""

import math
import time
from collections.abc import Callable, Mapping
from dataclasses import replace
from typing import Any, Self

from dehyst.drivers.apt import codec
from dehyst.drivers.apt.codec import FULL_OUTPUT, VOLTAGE_LIMITS_V, encode_apt
from dehyst.drivers.apt.link import AptKind, AptLink
from dehyst.drivers.call_times import Batches, CallTimes
from dehyst.drivers.interface import (
    DeviceGone,
    DeviceSpec,
    DriverConfigError,
    OutOfRange,
    ProtocolError,
    UnitIdentity,
)
from dehyst.drivers.kpz101.settings import Kpz101Settings
from dehyst.drivers.settings import read_settings

KIND = AptKind("kpz101", models=("KPZ101", "TPZ001"), prefixes=("29", "81"))
BATCHES = Batches()

EXPECTED_S, MOST_HZ = 0.01, 1000.0
"""A write before the unit has been timed, and what none exceeds: USB has a frame a millisecond."""

HIGHEST_V = max(VOLTAGE_LIMITS_V.values())

READBACK_COUNTS = 33
"""How far the reported output may be from what was set: 0.1 % of the limit, room for rounding in
the unit. A set that was not carried out is off by more, or does not matter."""


class Kpz101:
    """Thorlabs KPZ101 piezo driver on USB serial, open loop, 75, 100 or 150 V."""

    settings_type = Kpz101Settings

    def __init__(
        self, settings: Kpz101Settings, clock: Callable[[], float] = time.monotonic
    ) -> None:
        self.settings = settings
        self._clock = clock
        self._link: AptLink | None = None
        self._limit_v = float(settings.limit_v or HIGHEST_V)
        self._set_v = math.nan
        self.unit: UnitIdentity | None = None
        self._known: UnitIdentity | None = None
        self.spec = DeviceSpec(
            unit="v",
            minimum=0.0,
            maximum=settings.max_v or self._limit_v,
            resolution=self._limit_v / FULL_OUTPUT,
            max_rate_hz=MOST_HZ,
            latency_s=EXPECTED_S,
        )

    @classmethod
    def from_settings(cls, settings: Mapping[str, Any]) -> Self:
        """Make a driver; DriverConfigError names a wrong key."""
        return cls(read_settings(cls.settings_type, settings))

    def expect(self, unit: UnitIdentity) -> None:
        """From now on open() and reconnect() raise ForeignUnit where another one answers."""
        self._known = unit

    def open(self) -> None:
        """Connect, identify, check mode, sources and limit, enable the output and time a few sets
        to where it stands. It does not move: one that was disabled is enabled at 0 V."""
        if self._link is not None:
            return
        settings = self.settings
        known = self._known.serial if self._known else None
        path = KIND.find_port(settings.port, settings.serial_number or known)
        link = AptLink(path, settings.timeout_s, settings.rtscts, self._clock)
        try:
            found, identity = link.identify(KIND, settings.serial_number, self._known)
            check_ready(link)
            limit_v = self._checked_limit_v(link)
            maximum_v = settings.max_v or limit_v
            enable(link)
            counts = reported_counts(link)
            set_v = counts / FULL_OUTPUT * limit_v
            if not 0.0 <= set_v <= maximum_v:
                raise DriverConfigError(
                    f"{link.path}: the output stands at {set_v:g} V, outside the 0 to "
                    f"{maximum_v:g} V allowed; bring it there by hand, or change max_v"
                )
            # what it stands at is set again: a set costs the unit as much as the request for it
            again = encode_apt("pz_set_outputvolts", chan=1, voltage=counts)
            times = BATCHES.best(lambda: reported_counts(link, again), self._clock)
        except BaseException:
            link.close()
            raise
        self._link, self._limit_v, self._set_v = link, limit_v, set_v
        self.unit = self._known = found
        self.spec = replace(
            self.spec,
            maximum=maximum_v,
            resolution=limit_v / FULL_OUTPUT,
            identity=f"{identity} limit {limit_v:g} V",
        )
        self._update_spec(times)

    def write(self, volts: float) -> None:
        """Set the output, rounded to a count; returns when the unit has reported it.

        Raises OutOfRange (nothing written), DeviceTimeout, DeviceGone, and ProtocolError where the
        unit reports another voltage: output() is then what it reports.
        """
        link = self._require_link()
        counts = self._counts(volts)
        set_v = counts / FULL_OUTPUT * self._limit_v
        command = encode_apt("pz_set_outputvolts", chan=1, voltage=counts)
        found = reported_counts(link, command)
        if abs(found - counts) > READBACK_COUNTS:
            self._set_v = found / FULL_OUTPUT * self._limit_v
            raise ProtocolError(
                f"{link.path}: the unit was set to {set_v:g} V and reports {self._set_v:g} V; "
                "check that it is in open loop and that nobody turns its wheel"
            )
        self._set_v = set_v

    def output(self) -> float:
        """The set-point in V that the unit reported last; NaN before open()."""
        return self._set_v

    def reconnect(self) -> None:
        """Open the port again, see that the same unit answers, and ask it where its output stands;
        the output does not move."""
        self.close()
        self.open()

    def close(self) -> None:
        """Give the port back; the output stays where it is. Safe to call twice."""
        if self._link is not None:
            self._link.close()
            self._link = None

    def _checked_limit_v(self, link: AptLink) -> float:
        """The unit's voltage limit. Raises DriverConfigError where it is not what the settings
        want, or leaves less than their range."""
        code = link.ask("pz_req_tpz_iosettings", "pz_get_tpz_iosettings", chan=1).values[
            "voltage_limit"
        ]
        limit_v = VOLTAGE_LIMITS_V.get(int(code))
        if limit_v is None:
            raise ProtocolError(f"{link.path}: the unit reports the unknown voltage limit {code}")
        wanted_v, max_v = self.settings.limit_v, self.settings.max_v
        if wanted_v is not None and limit_v != wanted_v:
            raise DriverConfigError(
                f"{link.path}: the unit's voltage limit is {limit_v:g} V, limit_v is {wanted_v} V; "
                "change the one on the unit's panel or the other in the settings"
            )
        if max_v is not None and max_v > limit_v:
            raise DriverConfigError(
                f"{link.path}: max_v is {max_v:g} V, above the unit's voltage limit of "
                f"{limit_v:g} V; lower max_v, or raise the limit on the unit's panel if the stage "
                "admits it"
            )
        return limit_v

    def _counts(self, volts: float) -> int:
        minimum, maximum = self.spec.minimum, self.spec.maximum
        if not minimum <= volts <= maximum:  # NaN included
            raise OutOfRange(
                f"{volts:g} V is outside the {minimum:g} to {maximum:g} V of the KPZ101; nothing "
                "was written"
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

    def _require_link(self) -> AptLink:
        if self._link is None:
            raise DeviceGone(f"kpz101 at {self.settings.port} is not open")
        return self._link


def reported_counts(link: AptLink, first: bytes = b"") -> int:
    """The output voltage in counts that the unit reports, after the messages in `first`."""
    reply = link.ask("pz_req_outputvolts", "pz_get_outputvolts", first, chan=1)
    return int(reply.values["voltage"])


def check_ready(link: AptLink) -> None:
    """Raise DriverConfigError unless the unit is in open loop and follows software alone."""
    mode = link.ask("pz_req_poscontrolmode", "pz_get_poscontrolmode", chan=1).values["mode"]
    if mode != codec.OPEN_LOOP:
        raise DriverConfigError(
            f"{link.path}: the unit is in position control mode {mode}; set it to open loop "
            f"(mode {codec.OPEN_LOOP}) with the stage at rest: dehyst does not, as this moves the "
            "output"
        )
    source = link.ask("pz_req_inputvoltssrc", "pz_get_inputvoltssrc", chan=1).values["inputs"]
    if source != codec.SOFTWARE_ONLY:
        added = [
            name
            for bit, name in (
                (codec.EXTERNAL_SIGNAL, "the external signal"),
                (codec.POTENTIOMETER, "the potentiometer"),
            )
            if source & bit
        ]
        raise DriverConfigError(
            f"{link.path}: the unit adds {' and '.join(added) or f'source {source}'} to every "
            "set-point, so that none would be true; set its voltage source to software only"
        )


def enable(link: AptLink) -> None:
    """Enable the output without a jump: one that is disabled is set to 0 V before. Raises
    ProtocolError where the unit does not report 0 V, or stays disabled."""
    if _is_enabled(link):
        return
    zero = encode_apt("pz_set_outputvolts", chan=1, voltage=0)
    counts = reported_counts(link, zero)
    if counts != 0:
        raise ProtocolError(
            f"{link.path}: the output is disabled and its set-point stays at {counts} counts, to "
            "which it would jump; set it to 0 V and enable it by hand"
        )
    link.send("mod_set_chanenablestate", chan=1, state=codec.CHANNEL_ENABLED)
    if not _is_enabled(link):
        raise ProtocolError(f"{link.path}: the unit does not enable its output")


def _is_enabled(link: AptLink) -> bool:
    reply = link.ask("mod_req_chanenablestate", "mod_get_chanenablestate", chan=1)
    return int(reply.values["state"]) == codec.CHANNEL_ENABLED
