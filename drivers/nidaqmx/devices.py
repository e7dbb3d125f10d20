"""NI-DAQmx: a strain-gauge bridge in, an analog voltage out into the amplifier's EXT input.

The fast path: voltage at the piezo = gain x EXT volts (7.5, 10 or 15 on an MDT693B, by its limit
switch) on top of the voltage set by knob or USB, which this driver cannot know: set it to 0.

Needs the NI driver software and `pip install dehyst[nidaqmx]`; the package is imported when a
device is opened. Tested against a stand-in of the vendor package, not on hardware.

A delta-sigma bridge module delays every reading by its filter's group delay. That is a delay of
the sensor, not of the stage.
"""

import math
from collections.abc import Mapping
from typing import TYPE_CHECKING, Any, Self

from dehyst.drivers.interface import DeviceSpec, OutOfRange
from dehyst.drivers.nidaqmx.channel import Channel
from dehyst.drivers.nidaqmx.settings import EXT_V, NidaqmxActuatorSettings, NidaqmxSensorSettings
from dehyst.drivers.settings import read_settings

if TYPE_CHECKING:  # the compiled functions are made where somebody asks for them
    from dehyst.drivers.direct_calls import Direct

LATENCY_S = 5e-4  # of an on-demand call


class NidaqmxActuator(Channel):
    """Analog output into EXT; volts here are volts at the piezo."""

    settings_type = NidaqmxActuatorSettings

    def __init__(self, settings: NidaqmxActuatorSettings) -> None:
        super().__init__()
        self.settings = settings
        self.channel = settings.channel
        self._context["timeout_s"], self._context["gain"] = settings.timeout_s, settings.gain
        self._context["minimum"], self._context["maximum"] = settings.min_v, settings.max_v
        self._context["output_v"] = settings.initial_v
        self.spec = DeviceSpec(
            unit="v",
            minimum=settings.min_v,
            maximum=settings.max_v,
            resolution=2 * EXT_V / 2**settings.resolution_bits * settings.gain,
            max_rate_hz=settings.max_rate_hz,
            latency_s=LATENCY_S,
            identity=f"NI-DAQmx {settings.channel} into EXT, gain {settings.gain:g}",
        )

    @classmethod
    def from_settings(cls, settings: Mapping[str, Any]) -> Self:
        """Make a driver; DriverConfigError names a wrong key or a range EXT cannot reach."""
        return cls(read_settings(cls.settings_type, settings))

    def write(self, volts: float) -> None:
        """Set the voltage at the piezo. Raises OutOfRange, DeviceTimeout, DeviceGone."""
        task = self._ready()
        if not self.spec.minimum <= volts <= self.spec.maximum:
            raise OutOfRange(
                f"nidaqmx {self.channel}: {volts} V is outside {self.spec.minimum} to "
                f"{self.spec.maximum} V; nothing was written"
            )
        try:
            task.write(volts / self.settings.gain, timeout=self.settings.timeout_s)
        except self._error as error:
            raise self._failed(error) from None
        self._context["output_v"] = volts

    def output(self) -> float:
        """The last written voltage at the piezo, or initial_v."""
        return float(self._context["output_v"][0])

    def direct(self) -> "Direct | None":
        """How compiled code writes; None without the C library."""
        from dehyst.drivers.nidaqmx import direct_calls

        return direct_calls.actuator(self.channel, self._context)

    def _add_channel(self, task: Any, constants: Any) -> None:
        gain = self.settings.gain
        task.ao_channels.add_ao_voltage_chan(
            self.channel, min_val=self.settings.min_v / gain, max_val=self.settings.max_v / gain
        )


class NidaqmxSensor(Channel):
    """A full bridge of strain gauges, in micrometres."""

    settings_type = NidaqmxSensorSettings

    def __init__(self, settings: NidaqmxSensorSettings) -> None:
        super().__init__()
        self.settings = settings
        self.channel = settings.channel
        scale = settings.um_per_v_per_v
        self._context["timeout_s"] = settings.timeout_s
        self._context["gain"], self._context["zero"] = scale, settings.zero_v_per_v
        self._context["maximum"] = settings.range_v_per_v
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
        return cls(read_settings(cls.settings_type, settings))

    def read(self) -> float:
        """One reading [um]; NaN where the bridge is out of its range. Raises DeviceTimeout,
        DeviceGone."""
        task = self._ready()
        try:
            ratio = float(task.read(timeout=self.settings.timeout_s))
        except self._error as error:
            raise self._failed(error) from None
        if not abs(ratio) <= self.settings.range_v_per_v:
            return math.nan
        return (ratio - self.settings.zero_v_per_v) * self.settings.um_per_v_per_v

    def direct(self) -> "Direct | None":
        """How compiled code reads; None without the C library."""
        from dehyst.drivers.nidaqmx import direct_calls

        return direct_calls.sensor(self.channel, self._context)

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
