"""NI-DAQmx: an analog output into the amplifier's EXT input.

This is the fast path: voltage at the piezo = gain x (EXT volts - zero_v) (gain 7.5, 10 or 15 on an
MDT693B, depending on its limit switch) plus the voltage set by knob or USB, which this driver
cannot know: set it to 0.

With `clock_hz` the output is hardware-timed, one point at a time: a written voltage appears at the
next edge of the device's clock. There is no buffer, which would delay a loop by its length.
"""

from dataclasses import replace
from typing import TYPE_CHECKING, Any

from dehyst.drivers.driver import out_of_range
from dehyst.drivers.interface import DeviceSpec, DriverConfigError
from dehyst.drivers.nidaqmx.channel import Channel
from dehyst.drivers.nidaqmx.settings import NidaqmxActuatorSettings

if TYPE_CHECKING:  # the compiled functions are imported only where they are needed
    from dehyst.drivers.direct_calls import Direct

LATENCY_S = 1e-4
"""Duration of a write, typical of an internal device; one on USB takes about 1 ms. A write cannot
be timed without moving the output."""


class NidaqmxActuator(Channel):
    """Analog output into EXT, at once or by the device's clock; volts are volts at the piezo."""

    settings_type = NidaqmxActuatorSettings

    def __init__(self, settings: NidaqmxActuatorSettings) -> None:
        super().__init__()
        self.settings = settings
        self.channel = settings.channel
        self._context["timeout_s"] = settings.timeout_s
        self._context["gain"], self._context["zero"] = settings.gain, settings.zero_v
        self._context["minimum"], self._context["maximum"] = settings.min_v, settings.max_v
        self._context["output_v"] = settings.initial_v
        device_span_v = settings.device_max_v - settings.device_min_v
        self.spec = DeviceSpec(
            unit="v",
            minimum=settings.min_v,
            maximum=settings.max_v,
            resolution=device_span_v / 2**settings.resolution_bits * abs(settings.gain),
            max_rate_hz=settings.rate_hz,
            latency_s=min(LATENCY_S, 0.5 / settings.rate_hz),
            identity=self._words(),
            output_known=False,
        )

    def write(self, volts: float) -> None:
        """Set the voltage at the piezo [V]. Raises OutOfRange, DeviceTimeout, DeviceGone."""
        task = self._ready()
        if not self.spec.minimum <= volts <= self.spec.maximum:
            who = f"nidaqmx {self.channel}"
            raise out_of_range(who, volts, self.spec.minimum, self.spec.maximum)
        try:
            device_v = volts / self.settings.gain + self.settings.zero_v
            task.write(device_v, timeout=self.settings.timeout_s)
        except self._error as error:
            raise self._failed(error) from None
        self._context["output_v"] = volts

    def output(self) -> float:
        """Return the last written voltage at the piezo, or initial_v."""
        return float(self._context["output_v"][0])

    def direct(self) -> "Direct | None":
        """Return the C function that writes; None without the C library."""
        from dehyst.drivers.nidaqmx import direct_calls

        return direct_calls.actuator(self.channel, self._context)

    def _words(self) -> str:
        serial = f" serial {self.unit.serial}" if self.unit else ""
        clock = f", clock {self.settings.clock_hz:g} Hz" if self.settings.clock_hz else ""
        return (
            f"NI-DAQmx {self.product}{serial} {self.settings.channel} into EXT, gain "
            f"{self.settings.gain:g}{clock}"
        ).replace("  ", " ")

    def _add_channel(self, task: Any, constants: Any) -> None:
        low_v, high_v = self.settings.device_range_v
        task.ao_channels.add_ao_voltage_chan(self.channel, min_val=low_v, max_val=high_v)

    def _identify(self, task: Any) -> None:
        super()._identify(task)
        self.spec = replace(self.spec, identity=self._words())

    def _set_clock(self, task: Any, constants: Any) -> None:
        if self.settings.clock_hz is None:
            return
        if not next(iter(task.devices)).ao_samp_clk_supported:
            raise DriverConfigError(
                f"nidaqmx {self.channel}: the outputs of the {self.product} have no clock; leave "
                "clock_hz out"
            )
        task.timing.cfg_samp_clk_timing(
            self.settings.clock_hz,
            source=self.settings.clock_source,
            sample_mode=constants.AcquisitionType.HW_TIMED_SINGLE_POINT,
        )
