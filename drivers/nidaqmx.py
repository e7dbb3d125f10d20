"""NI-DAQmx: a strain-gauge bridge in, an analog voltage out into the amplifier's EXT input.

The fast path: voltage at the piezo = gain x EXT volts (7.5, 10 or 15 on an MDT693B, by its limit
switch) on top of the voltage set by knob or USB, which this driver cannot know: set it to 0.

Needs the NI driver software and `pip install dehyst[nidaqmx]`; the package is imported when a
device is opened. Tested against a stand-in of the vendor package, not on hardware.

A delta-sigma bridge module delays every reading by its filter's group delay. That is a delay of
the sensor, not of the stage.
"""

import importlib
import math
from collections.abc import Mapping
from dataclasses import dataclass, fields
from typing import Any, Self, TypeVar

from dehyst.drivers.interface import (
    DeviceGone,
    DeviceNotFound,
    DeviceSpec,
    DriverConfigError,
    OutOfRange,
)

LATENCY_S = 5e-4  # of an on-demand call
RATE_HZ = 1000.0


@dataclass(frozen=True)
class NidaqmxActuatorSettings:
    """channel: e.g. "Dev1/ao0". gain: piezo volts per EXT volt. min_v, max_v: at the piezo.
    resolution_bits: of the converter over its -10..10 V. initial_v: piezo voltage at which the
    channel stands when it is opened (the hardware cannot be asked). max_rate_hz: highest rate of
    on-demand writes."""

    channel: str
    gain: float = 15.0
    min_v: float = 0.0
    max_v: float = 150.0
    resolution_bits: int = 16
    initial_v: float = 0.0
    max_rate_hz: float = RATE_HZ


@dataclass(frozen=True)
class NidaqmxSensorSettings:
    """channel: e.g. "cDAQ1Mod1/ai0". um_per_v_per_v: displacement per bridge ratio. zero_v_per_v:
    bridge ratio at displacement 0. excitation_v: of the bridge. range_v_per_v: input range.
    max_rate_hz: highest rate of on-demand reads."""

    channel: str
    um_per_v_per_v: float
    zero_v_per_v: float = 0.0
    excitation_v: float = 2.5
    range_v_per_v: float = 0.025
    resolution_bits: int = 24
    max_rate_hz: float = RATE_HZ


Settings = TypeVar("Settings")


def parse(kind: type[Settings], table: Mapping[str, Any], above_zero: tuple[str, ...]) -> Settings:
    """Settings of `kind` from a table; DriverConfigError names a wrong key or value."""
    known = {f.name: f.type for f in fields(kind)}  # type: ignore[arg-type]
    for key, value in table.items():
        if key not in known:
            raise DriverConfigError(f"nidaqmx: unknown setting '{key}'; known: {', '.join(known)}")
        wanted: Any = {"str": str, "int": int}.get(
            getattr(known[key], "__name__", ""), (int, float)
        )
        number: Any = value
        if isinstance(value, bool) or not isinstance(value, wanted):
            raise DriverConfigError(f"nidaqmx: {key} = {value!r} has the wrong type")
        if isinstance(value, float) and not math.isfinite(value):
            raise DriverConfigError(f"nidaqmx: {key} = {value} is not finite")
        if key in above_zero and number <= 0:
            raise DriverConfigError(f"nidaqmx: {key} = {value} must be above 0")
    try:
        return kind(**table)
    except TypeError:
        raise DriverConfigError(
            f"nidaqmx: a setting is missing; known: {', '.join(known)}"
        ) from None


def vendor() -> Any:
    """The vendor package; DeviceNotFound says how to install it."""
    try:
        return importlib.import_module("nidaqmx")
    except ImportError as error:
        raise DeviceNotFound(
            "the NI-DAQmx package is not installed: pip install dehyst[nidaqmx], and the NI-DAQmx "
            f"driver from National Instruments ({error})"
        ) from None


class _Device:
    """A task with one channel."""

    channel = ""

    def __init__(self) -> None:
        self._task: Any = None
        self._error: type[Exception] = OSError

    def open(self) -> None:
        """Reserve the channel. Moves nothing."""
        if self._task is not None:
            return
        package = vendor()
        self._error = package.errors.DaqError
        task = None
        try:
            task = package.Task()
            self._add_channel(task, package.constants)
            task.start()
        except (self._error, OSError) as error:  # OSError: the package without the NI driver
            if task is not None:
                task.close()
            raise DeviceNotFound(f"nidaqmx {self.channel}: {error}") from None
        self._task = task

    def reconnect(self) -> None:
        """Reserve the channel again; the output does not move."""
        self.close()
        self.open()

    def close(self) -> None:
        """Release the channel; an output stays where it is. Safe to call twice."""
        if self._task is None:
            return
        task, self._task = self._task, None
        try:
            task.close()
        except self._error:  # the device has gone; there is nothing left to release
            return

    def _add_channel(self, task: Any, constants: Any) -> None:
        raise TypeError(f"{type(self).__name__} has no channel")

    def _ready(self) -> Any:
        if self._task is None:
            raise DeviceGone(f"nidaqmx {self.channel} is not open")
        return self._task


class NidaqmxActuator(_Device):
    """Analog output into EXT; volts here are volts at the piezo."""

    def __init__(self, settings: NidaqmxActuatorSettings) -> None:
        super().__init__()
        self.settings = settings
        self.channel = settings.channel
        self._output_v = settings.initial_v
        self.spec = DeviceSpec(
            unit="v",
            minimum=settings.min_v,
            maximum=settings.max_v,
            resolution=20.0 / 2**settings.resolution_bits * settings.gain,
            max_rate_hz=settings.max_rate_hz,
            latency_s=LATENCY_S,
            identity=f"NI-DAQmx {settings.channel} into EXT, gain {settings.gain:g}",
        )

    @classmethod
    def from_settings(cls, settings: Mapping[str, Any]) -> Self:
        """Make a driver; DriverConfigError names a wrong key or a range EXT cannot reach."""
        parsed = parse(
            NidaqmxActuatorSettings, settings, ("gain", "resolution_bits", "max_rate_hz")
        )
        ends = (parsed.min_v / parsed.gain, parsed.max_v / parsed.gain)
        if not -10.0 <= ends[0] < ends[1] <= 10.0:
            raise DriverConfigError(
                f"nidaqmx: min_v = {parsed.min_v}, max_v = {parsed.max_v} at gain {parsed.gain} "
                f"is {ends[0]:g} to {ends[1]:g} V at EXT; the output has -10 to 10 V"
            )
        if not parsed.min_v <= parsed.initial_v <= parsed.max_v:
            raise DriverConfigError(f"nidaqmx: initial_v = {parsed.initial_v} is out of range")
        return cls(parsed)

    def write(self, volts: float) -> None:
        """Set the voltage at the piezo. Raises OutOfRange, or DeviceGone when the call fails."""
        task = self._ready()
        if not self.spec.minimum <= volts <= self.spec.maximum:
            raise OutOfRange(
                f"nidaqmx {self.channel}: {volts} V is outside {self.spec.minimum} to "
                f"{self.spec.maximum} V; nothing was written"
            )
        try:
            task.write(volts / self.settings.gain)
        except self._error as error:
            self.close()
            raise DeviceGone(f"nidaqmx {self.channel}: {error}") from None
        self._output_v = volts

    def output(self) -> float:
        """The last written voltage at the piezo, or initial_v."""
        return self._output_v

    def _add_channel(self, task: Any, constants: Any) -> None:
        gain = self.settings.gain
        task.ao_channels.add_ao_voltage_chan(
            self.channel, min_val=self.settings.min_v / gain, max_val=self.settings.max_v / gain
        )


class NidaqmxSensor(_Device):
    """A full bridge of strain gauges, in micrometres."""

    def __init__(self, settings: NidaqmxSensorSettings) -> None:
        super().__init__()
        self.settings = settings
        self.channel = settings.channel
        scale = settings.um_per_v_per_v
        ends = sorted(
            (side * settings.range_v_per_v - settings.zero_v_per_v) * scale for side in (-1, 1)
        )
        self.spec = DeviceSpec(
            unit="um",
            minimum=ends[0],
            maximum=ends[1],
            resolution=(ends[1] - ends[0]) / 2**settings.resolution_bits,
            max_rate_hz=settings.max_rate_hz,
            latency_s=LATENCY_S,
            identity=f"NI-DAQmx bridge {settings.channel}",
        )

    @classmethod
    def from_settings(cls, settings: Mapping[str, Any]) -> Self:
        """Make a driver; DriverConfigError names a wrong key."""
        above = ("excitation_v", "range_v_per_v", "resolution_bits", "max_rate_hz")
        parsed = parse(NidaqmxSensorSettings, settings, above)
        if parsed.um_per_v_per_v == 0:
            raise DriverConfigError("nidaqmx: um_per_v_per_v must not be 0")
        return cls(parsed)

    def read(self) -> float:
        """One reading [um]; NaN where the bridge is out of its range. Raises DeviceGone."""
        task = self._ready()
        try:
            ratio = float(task.read())
        except self._error as error:
            self.close()
            raise DeviceGone(f"nidaqmx {self.channel}: {error}") from None
        if not abs(ratio) <= self.settings.range_v_per_v:
            return math.nan
        return (ratio - self.settings.zero_v_per_v) * self.settings.um_per_v_per_v

    def _add_channel(self, task: Any, constants: Any) -> None:
        task.ai_channels.add_ai_bridge_chan(
            self.channel,
            min_val=-self.settings.range_v_per_v,
            max_val=self.settings.range_v_per_v,
            units=constants.BridgeUnits.VOLTS_PER_VOLT,
            bridge_config=constants.BridgeConfiguration.FULL_BRIDGE,
            voltage_excit_source=constants.ExcitationSource.INTERNAL,
            voltage_excit_val=self.settings.excitation_v,
        )
