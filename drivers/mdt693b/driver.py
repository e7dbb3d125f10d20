"""Driver of the Thorlabs MDT693B and MDT694B piezo amplifiers on a serial port (USB CDC-ACM).

The unit cannot report its set-point: `xvoltage?` reads an ADC with an offset of about 0.2 V and a
lag of up to 0.25 s. The driver therefore keeps the set-point in software. Right after open() it is
known only as accurately as that readback (about 0.3 V), unless the setting `initial_v` gives it. No
loop is ever closed on the readback.

Outputs of one unit, driven in one process, share its port: see unit.py and together.py.

Commands that move an output by themselves (`restore`) are never sent. The limits of the unit
(voltage switch, axis minimum and maximum) are read and respected: a value outside them raises
OutOfRange before a byte is written.
"""

import math
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import replace
from typing import ClassVar

from dehyst.drivers.call_times import CallTimes
from dehyst.drivers.driver import IdentifiedDriver
from dehyst.drivers.interface import (
    DeviceGone,
    DeviceSpec,
    DeviceTimeout,
    DriverConfigError,
    ForeignUnit,
    OutOfRange,
    ProtocolError,
    UnitIdentity,
    refuse_another,
)
from dehyst.drivers.mdt693b.codec import Dialect
from dehyst.drivers.mdt693b.link import CommandRefused, Mdt693bLink
from dehyst.drivers.mdt693b.settings import (
    HIGHEST_V,
    Mdt69xConfig,
    Mdt693bConfig,
    Mdt694bConfig,
    find_port,
)
from dehyst.drivers.mdt693b.together import JointOutputs
from dehyst.drivers.mdt693b.tuning import TUNING
from dehyst.drivers.mdt693b.unit import SharedUnit, shared_unit
from dehyst.drivers.mdt693b.unit_facts import NATIVE, check_model, check_serial, learn
from dehyst.drivers.serial_port import SerialPort, place_of

DAC_STEP_V = 2.75e-3
"""Step of the unit's 16-bit converter."""
DECIMALS = 3
"""Decimals of a voltage in a command: 1 mV, finer than the converter's step."""


class Mdt693b(IdentifiedDriver):
    """Thorlabs MDT693B or MDT694B piezo amplifier on a serial port, one axis.

    An Actuator; its settings are those of Mdt693bConfig.

    timing: durations of write(); `spec.latency_s` (median), `spec.late_s` (the 95th
    percentile) and `spec.max_rate_hz` (from the 75th) are measured at open() with harmless queries
    and from then on with the sets themselves. stray_bytes: unsolicited bytes received so far.
    """

    settings_type: ClassVar[type[Mdt69xConfig]] = Mdt693bConfig

    def __init__(
        self,
        config: Mdt69xConfig,
        clock: Callable[[], float] = time.monotonic,
        sleep: Callable[[float], None] = time.sleep,
    ) -> None:
        self.config = config
        self.timing = CallTimes()
        self.spec = DeviceSpec(
            unit="v",
            minimum=0.0,
            maximum=HIGHEST_V if config.max_v is None else config.max_v,
            resolution=DAC_STEP_V,
            max_rate_hz=config.rate_hz or TUNING.expected_rate_hz,
            latency_s=1.0 / (config.rate_hz or TUNING.expected_rate_hz),
        )
        self._clock = clock
        self._sleep = sleep
        self._link: Mdt693bLink | None = None
        self._unit: SharedUnit | None = None
        self._timed_before = False
        self._words = NATIVE
        self._set_v = math.nan  # the last acknowledged set-point
        self._tried_v: float | None = None  # a set whose outcome is unknown
        self._stray_before = 0

    @property
    def serial_number(self) -> str | None:
        """The unit's serial number; "" if it is blank, None before open()."""
        return None if self.unit is None else self.unit.serial

    @property
    def stray_bytes(self) -> int:
        return self._stray_before + (self._link.stray_bytes if self._link else 0)

    @property
    def dialect(self) -> Dialect | None:
        """The dialect of the unit; None while closed."""
        return self._link.dialect if self._link else None

    def open(self) -> None:
        """Connect, find the dialect, read identity and limits, measure the rate. The output does
        not move. Raises DeviceNotFound, DeviceTimeout, ProtocolError, DriverConfigError."""
        if self._link is not None:
            return
        self._connect()
        initial_v = self.config.initial_v
        with self._closed_on_failure():
            readback_v = self._settled_readback(initial_v)
        if initial_v is not None and abs(initial_v - readback_v) > TUNING.readback_tolerance_v:
            self.close()
            raise DriverConfigError(
                f"setting initial_v is {initial_v:g} V but the unit reads back {readback_v:g} V; "
                "correct it or leave it out"
            )
        self._set_v = self._inside(readback_v) if initial_v is None else initial_v
        self._tried_v = None

    def write(self, volts: float) -> None:
        """Set the output to `volts`, rounded to 1 mV; return when the unit has acknowledged.

        Raises OutOfRange (nothing written); DeviceTimeout when the acknowledgement does not arrive
        in time (the set is neither queued nor repeated; output() returns the last one that was
        acknowledged, and the next call first makes sure that no reply is outstanding);
        ProtocolError when the unit refuses or gives an invalid answer; DeviceGone after an unplug.
        """
        self._opened()
        volts = self.admit(volts)
        started_s = self._clock()
        with self.conversation() as link:
            self.get_in_step(link)
            self.trying(volts)
            try:
                link.set(self.word("set", volts=volts))
            except CommandRefused:
                self.trying(None)
                raise
            self.carried_out(volts)
        self.timing.add(self._clock() - started_s)
        if self.timing.count % TUNING.measured_after == 0:
            self._update_spec(self.timing)

    def output(self) -> float:
        """Return the last acknowledged set-point in V; after open() the readback, accurate to 0.3
        V, or `initial_v`. NaN before open()."""
        return self._set_v

    def readback(self) -> float:
        """Return the voltage in V that the unit's ADC measures. It is late and has an offset: use
        it for slow checks only. Takes a round trip like write()."""
        with self.conversation() as link:
            self.get_in_step(link)
            return float(link.ask(self.word("read")).value)

    def reconnect(self) -> None:
        """Restore the link after DeviceGone or DeviceTimeout. The dialect is detected and the
        limits are read again; the output does not move. Raises ForeignUnit when another unit
        answers, or may have: one without a serial number whose output is not where it was left.

        The set-point remains the last acknowledged one. If a set was in progress when the link was
        lost, the readback decides whether it was carried out; a readback far from both (the unit
        was switched off, the knob was turned) becomes the known output.
        """
        tried_v, was_open = self._tried_v, not math.isnan(self._set_v)
        self.close()
        if not was_open:
            return self.open()
        self._connect()
        candidates = [self._set_v] if tried_v is None else [self._set_v, tried_v]
        with self._closed_on_failure():
            readback_v = self._settled_readback(*candidates)
        nearest_v = min(candidates, key=lambda volts: abs(volts - readback_v))
        near = abs(nearest_v - readback_v) <= TUNING.readback_tolerance_v
        if not near and self.unit is not None and not self.unit.serial:
            self.close()
            raise ForeignUnit(
                f"{self.config.port}: a unit without a serial number is back at {readback_v:.2f} "
                f"V, but the output was left at {nearest_v:.2f} V; it may be another unit, so "
                "nothing was set on it. Put the known unit back, or accept this one with `dehyst "
                "config pin`"
            )
        self._set_v = nearest_v if near else self._inside(readback_v)
        self._tried_v = None
        return None

    def close(self) -> None:
        """Close the port; the output stays where it is. Safe to call twice."""
        if self._link is not None:
            self._stray_before += self._link.stray_bytes
        self._link, unit, self._unit = None, self._unit, None
        if unit is not None and (last := unit.release(self.config.axis, self)) is not None:
            last.close()

    # -- with the other outputs of the unit

    @property
    def unit_key(self) -> str:
        """The same string for all outputs of one unit."""
        return str(id(self._unit)) if self._unit is not None else ""

    def join(self, others: Sequence["Mdt693b"]) -> JointOutputs:
        """Combine this output with others of the unit, all open; measure their joint rate."""
        return JointOutputs((self, *others), self._clock)

    @contextmanager
    def conversation(self) -> Iterator[Mdt693bLink]:
        """Yield the link, reserved for this thread. Raises DeviceGone if it is lost. An error
        inside the block counts as a loss for all outputs of the unit, except a command that was
        refused."""
        link, unit = self._opened(), self._unit
        if unit is None:
            yield link
            return
        with unit.lock:
            try:
                yield self._opened()
            except CommandRefused:
                raise
            except (DeviceGone, DeviceTimeout, ProtocolError) as error:
                unit.lose(error)
                raise

    def trying(self, volts: float | None) -> None:
        """Note that a set is sent whose outcome is not known yet; None: it was refused."""
        self._tried_v = volts

    def carried_out(self, volts: float) -> None:
        """Note that the unit has acknowledged this set-point."""
        self._set_v, self._tried_v = volts, None

    # -- internal

    def _connect(self) -> None:
        """Do the part of open() and reconnect() that does not concern the set-point."""
        unit = shared_unit(self.config)
        unit.claim(self.config, self)
        self._unit = unit
        with self._closed_on_failure():
            self._link = unit.connect(self._new_link)
            self._learn()

    def _new_link(self) -> Mdt693bLink:
        config = self.config
        path = find_port(config, self._known.serial if self._known else None)
        port = SerialPort(path, config.baud, config.write_timeout_s, clock=self._clock)
        link = Mdt693bLink(port, config.timeout_s, config.idle_s, self._clock)
        try:
            link.handshake()
        except Exception:
            link.close()
            raise
        return link

    def _learn(self) -> None:
        config = self.config
        with self.conversation() as link:
            facts = learn(link, config.axis, config.max_v)
        path = link.port.path
        check_model(path, facts.kind, config.model)
        check_serial(path, facts.serial_number, config.serial_number)
        found = UnitIdentity(facts.serial_number, facts.kind, place_of(path))
        refuse_another(path, found, self._known)
        self.unit = self._known = found
        self._words = facts.words
        self.spec = replace(
            self.spec, minimum=facts.minimum_v, maximum=facts.maximum_v, identity=facts.identity
        )
        # while other outputs use the link, the earlier measurement is kept
        alone = self._unit is None or not self._unit.shared
        if config.rate_hz is None and (alone or not self._timed_before):
            self._update_spec(TUNING.batches.best(self._ask, self._clock))
            self._timed_before = True

    def _ask(self) -> None:
        """Take a reading, to time it."""
        with self.conversation() as link:
            link.ask(self.word("read"))

    def get_in_step(self, link: Mdt693bLink) -> None:
        """Before the next command, find out what happened to a set that was not acknowledged."""
        link.get_in_step()
        tried_v, self._tried_v = self._tried_v, None
        acks, refusals = link.late.acks, link.late.refusals
        link.late.clear()
        if tried_v is not None and acks > 0:
            self._set_v = tried_v
        elif tried_v is None and refusals > 0:
            raise ProtocolError(
                f"{link.port.path}: the unit refused a command after it had been acknowledged; "
                "the output voltage is uncertain, reconnect to read it"
            )

    def _update_spec(self, timing: CallTimes) -> None:
        self.spec = replace(
            self.spec,
            max_rate_hz=self.config.rate_hz or TUNING.batches.rate_hz(timing),
            latency_s=timing.percentile_s(50.0),
            late_s=TUNING.batches.late_s(timing),
        )

    def admit(self, volts: float) -> float:
        """Return `volts` as it will be written: in range, rounded, not beyond a limit."""
        minimum, maximum = self.spec.minimum, self.spec.maximum
        if not minimum <= volts <= maximum:  # NaN included
            raise OutOfRange(
                f"{volts:g} V is outside the {minimum:g} to {maximum:g} V of axis "
                f"{self.config.axis}; nothing was written"
            )
        rounded = round(volts, DECIMALS)
        step = 10.0**-DECIMALS
        if rounded > maximum:
            rounded = math.floor(maximum / step) * step
        elif rounded < minimum:
            rounded = math.ceil(minimum / step) * step
        return rounded + 0.0  # no -0.0

    def _settled_readback(self, *expected: float | None) -> float:
        """Return the readback once settled, or as soon as it is near an expected value."""
        give_up_s = self._clock() + TUNING.longest_settle_s
        before_v = math.nan
        while True:
            volts = self.readback()
            near = any(
                e is not None and abs(volts - e) <= TUNING.readback_tolerance_v for e in expected
            )
            if near or abs(volts - before_v) < TUNING.settled_v or self._clock() > give_up_s:
                return volts
            before_v = volts
            self._sleep(TUNING.settle_s)

    def _inside(self, volts: float) -> float:
        """Clip a readback, which has an offset, to the range that can be written."""
        inside_v = min(max(volts, self.spec.minimum), self.spec.maximum)
        if abs(inside_v - volts) > TUNING.readback_tolerance_v:
            self.close()
            raise DriverConfigError(
                f"the output is at {volts:g} V, outside the {self.spec.minimum:g} to "
                f"{self.spec.maximum:g} V allowed; bring it into that range by hand, or change "
                "the limits"
            )
        return inside_v

    def word(self, name: str, volts: float = 0.0) -> str:
        return self._words[name].format(axis=self.config.axis, volts=volts)

    def _opened(self) -> Mdt693bLink:
        if self._link is None:
            raise DeviceGone("the MDT693B is not open: call open() or reconnect()")
        unit = self._unit
        if unit is not None and (unit.lost or unit.link is not self._link):
            raise DeviceGone(f"the link to the unit was lost: {unit.lost or 'opened again since'}")
        return self._link


class Mdt694b(Mdt693b):
    """Thorlabs MDT694B piezo amplifier on a serial port: one channel of the MDT693B's firmware.

    Raises ForeignUnit where another model answers.
    """

    settings_type = Mdt694bConfig
