"""NI-DAQmx: an analog voltage or strain-gauge bridge input, in micrometres.

A reading is the mean of `average` samples: taken when the reading is requested, or with `sample_hz`
the newest of those that the device samples continuously by its own clock. The mean is late by half
the time that its samples span, and a delta-sigma module delays every reading by its filter's group
delay. Both delays belong to the sensor, not to the stage.
"""

import ctypes
import math
import time
from collections.abc import Callable
from dataclasses import replace
from typing import TYPE_CHECKING, Any

import numpy as np

from dehyst.drivers.call_times import Batches
from dehyst.drivers.interface import DeviceSpec
from dehyst.drivers.nidaqmx.channel import Channel
from dehyst.drivers.nidaqmx.settings import NidaqmxSensorSettings

if TYPE_CHECKING:  # the compiled functions are imported only where they are needed
    from dehyst.drivers.direct_calls import Direct

BATCHES = Batches()

EXPECTED_RATE_HZ = 1000.0
"""Assumed rate before the channel has been timed, as for writes on demand."""

BUFFER_S = 1.0
"""Length of the sample buffer [s]: far more than one reading, little enough memory."""


class NidaqmxSensor(Channel):
    """Analog input in micrometres: a voltage, or a full bridge of strain gauges."""

    settings_type = NidaqmxSensorSettings

    def __init__(
        self, settings: NidaqmxSensorSettings, clock: Callable[[], float] = time.monotonic
    ) -> None:
        super().__init__()
        self.settings = settings
        self.channel = settings.channel
        self._clock = clock
        self._timed = False
        c = self._context
        c["timeout_s"], c["gain"], c["zero"] = settings.timeout_s, settings.scale, settings.zero
        c["minimum"], c["maximum"] = settings.ends
        if settings.average > 1 or settings.sample_hz is not None:
            self._room = np.zeros(settings.average + 1)
            c["count"], c["samples"] = settings.average, self._room.ctypes.data
        ends = sorted((end - settings.zero) * settings.scale for end in settings.ends)
        rate_hz = settings.max_rate_hz or EXPECTED_RATE_HZ
        self.spec = DeviceSpec(
            unit="um",
            minimum=ends[0],
            maximum=ends[1],
            resolution=(ends[1] - ends[0]) / 2**settings.resolution_bits,
            max_rate_hz=rate_hz,
            latency_s=1.0 / rate_hz,
            identity=self._words(),
        )

    def read(self) -> float:
        """Take one reading [um]; NaN if a sample is out of range. Raises DeviceTimeout,
        DeviceGone."""
        task, settings = self._ready(), self.settings
        count, total = int(self._context["count"][0]), 0.0
        low, high = settings.ends
        try:
            if count:
                samples = task.read(count, timeout=settings.timeout_s)
            else:
                samples = [task.read(timeout=settings.timeout_s)]
        except self._error as error:
            raise self._failed(error) from None
        for sample in samples:
            if not low <= sample <= high:
                return math.nan
            total += sample
        return (total / len(samples) - settings.zero) * settings.scale

    def direct(self) -> "Direct | None":
        """Return the C function that reads; None without the C library."""
        from dehyst.drivers.nidaqmx import direct_calls

        return direct_calls.sensor(self.channel, self._context)

    def _words(self) -> str:
        settings = self.settings
        serial = f" serial {self.unit.serial}" if self.unit else ""
        mean = f", mean of {settings.average}" if settings.average > 1 else ""
        clock = f", sampled at {settings.sample_hz:g} Hz" if settings.sample_hz else ""
        words = f"NI-DAQmx {self.product}{serial} {settings.input} {settings.channel}"
        return (words + mean + clock).replace("  ", " ")

    def _add_channel(self, task: Any, constants: Any) -> None:
        settings = self.settings
        if settings.input == "voltage":
            wiring = settings.terminals.replace("-", "_").upper()
            task.ai_channels.add_ai_voltage_chan(
                self.channel,
                terminal_config=getattr(constants.TerminalConfiguration, wiring),
                min_val=settings.min_v,
                max_val=settings.max_v,
            )
            return
        task.ai_channels.add_ai_bridge_chan(
            self.channel,
            min_val=-settings.range_v_per_v,
            max_val=settings.range_v_per_v,
            units=constants.BridgeUnits.VOLTS_PER_VOLT,
            bridge_config=constants.BridgeConfiguration.FULL_BRIDGE,
            voltage_excit_source=constants.ExcitationSource.INTERNAL,
            voltage_excit_val=settings.excitation_v,
        )

    def _identify(self, task: Any) -> None:
        super()._identify(task)
        self.spec = replace(self.spec, identity=self._words())

    def _set_clock(self, task: Any, constants: Any) -> None:
        settings = self.settings
        if settings.sample_hz is None:
            return
        task.timing.cfg_samp_clk_timing(
            settings.sample_hz,
            source=settings.clock_source,
            sample_mode=constants.AcquisitionType.CONTINUOUS,
            samps_per_chan=max(2 * settings.average, math.ceil(BUFFER_S * settings.sample_hz)),
        )
        task.in_stream.over_write = constants.OverwriteMode.OVERWRITE_UNREAD_SAMPLES

    def _started(self, task: Any, constants: Any) -> None:
        """Wait for the first `average` samples, then read the newest ones from now on."""
        settings = self.settings
        if settings.sample_hz is None:
            return
        task.read(settings.average, timeout=settings.timeout_s)
        task.in_stream.relative_to = constants.ReadRelativeTo.MOST_RECENT_SAMPLE
        task.in_stream.offset = -settings.average

    def _prove(self) -> None:
        """Measure, once, how long a reading takes, with compiled code if possible."""
        if self._timed:
            return
        times, settings = BATCHES.best(self._fastest(), self._clock), self.settings
        # a reading without a new sample does not count
        most_hz = math.inf if settings.sample_hz is None else settings.sample_hz
        who = f"nidaqmx {self.channel}"
        self.spec = BATCHES.with_rate(self.spec, times, settings.max_rate_hz, who, most_hz)
        self._timed = True

    def _fastest(self) -> Callable[[], object]:
        direct = self.direct()
        if direct is None:
            return self.read
        context, value = ctypes.c_void_p(direct.context), ctypes.c_double()
        pointer = ctypes.POINTER(ctypes.c_double)
        call = ctypes.CFUNCTYPE(ctypes.c_int32, ctypes.c_void_p, ctypes.c_int64, pointer)(
            direct.function
        )
        explain = direct.explain

        def timed() -> None:
            status = call(context, 0, ctypes.byref(value))
            if status:
                raise explain(status)

        return timed
