"""The settings of the NI-DAQmx drivers."""

from typing import Annotated, Literal

from msgspec import Meta

from dehyst.drivers.analog import check_output_range
from dehyst.drivers.settings import Settings

ON_DEMAND_HZ = 1000.0  # assumed write rate unless the device's is given
TIMEOUT_S = 0.2  # a call usually takes 0.1 ms, about 1 ms over USB

Terminals = Literal["default", "rse", "nrse", "diff", "pseudo-diff"]


class ClockedSettings(Settings, frozen=True, kw_only=True):
    """Settings that an output and an input have in common."""

    driver = "nidaqmx"

    timeout_s: Annotated[float, Meta(gt=0, le=10, description="time-out of one call")] = TIMEOUT_S
    clock_source: Annotated[
        str,
        Meta(
            description='terminal of the sample clock, e.g. "/Dev1/ai/SampleClock"; '
            '"": its own clock'
        ),
    ] = ""


class NidaqmxActuatorSettings(ClockedSettings, frozen=True, kw_only=True):
    """An analog output into the amplifier's EXT input; volts are volts at the piezo."""

    channel: Annotated[str, Meta(min_length=1, description='the output, e.g. "Dev1/ao0"')]
    gain: Annotated[
        float, Meta(description="volts at the piezo per volt at EXT, not 0; negative if inverting")
    ] = 15.0
    zero_v: Annotated[float, Meta(description="volts at EXT where the piezo has 0 V")] = 0.0
    min_v: Annotated[float, Meta(description="lowest voltage at the piezo")] = 0.0
    max_v: Annotated[float, Meta(description="highest voltage at the piezo")] = 150.0
    device_min_v: Annotated[
        float, Meta(description="lowest voltage of the device's output")
    ] = -10.0
    device_max_v: Annotated[float, Meta(description="highest voltage of the device's output")] = (
        10.0
    )
    resolution_bits: Annotated[
        int, Meta(gt=0, le=64, description="resolution of the converter, over the device's range")
    ] = 16
    initial_v: Annotated[
        float,
        Meta(description="voltage at the piezo at start, which the hardware does not report"),
    ] = 0.0
    clock_hz: (
        Annotated[
            float,
            Meta(
                gt=0,
                description="rate of the device clock on whose edges the output changes; "
                "at once if left out",
            ),
        ]
        | None
    ) = None
    max_rate_hz: (
        Annotated[
            float,
            Meta(gt=0, description="highest rate of writes; if left out, clock_hz or 1000 Hz"),
        ]
        | None
    ) = None

    @property
    def device_range_v(self) -> tuple[float, float]:
        """The lowest and highest voltage at EXT for min_v to max_v."""
        low, high = sorted(v / self.gain + self.zero_v for v in (self.min_v, self.max_v))
        return low, high

    @property
    def rate_hz(self) -> float:
        """The highest rate of writes."""
        return self.max_rate_hz or self.clock_hz or ON_DEMAND_HZ

    def check(self) -> None:
        """Refuse a range that EXT cannot reach."""
        check_output_range(self, "EXT")
        if not self.min_v <= self.initial_v <= self.max_v:
            raise self.wrong("initial_v", f"from {self.min_v:g} to {self.max_v:g}")
        if self.clock_hz is None and self.clock_source:
            raise self.wrong("clock_source", "left out where clock_hz is")
        if self.clock_hz is not None and self.rate_hz > self.clock_hz:
            raise self.wrong("max_rate_hz", f"at most clock_hz = {self.clock_hz:g}")


class NidaqmxSensorSettings(ClockedSettings, frozen=True, kw_only=True):
    """An analog input: a full bridge of strain gauges, or a voltage."""

    channel: Annotated[str, Meta(min_length=1, description='the input, e.g. "cDAQ1Mod1/ai0"')]
    input: Annotated[
        Literal["bridge", "voltage"],
        Meta(description="a full bridge, or the voltage of a monitor, a probe, an interferometer"),
    ] = "bridge"
    um_per_v_per_v: (
        Annotated[
            float,
            Meta(
                description="bridge: displacement per bridge ratio, not 0; a negative "
                "value reverses it"
            ),
        ]
        | None
    ) = None
    zero_v_per_v: Annotated[float, Meta(description="bridge: ratio at displacement 0")] = 0.0
    excitation_v: Annotated[float, Meta(gt=0, description="bridge: its supply")] = 2.5
    range_v_per_v: Annotated[
        float,
        Meta(gt=0, description="bridge: range on either side; beyond it a reading is NaN"),
    ] = 0.025
    um_per_v: (
        Annotated[
            float,
            Meta(description="voltage: displacement per volt, not 0; a negative value reverses it"),
        ]
        | None
    ) = None
    zero_v: Annotated[float, Meta(description="voltage: volts at displacement 0")] = 0.0
    min_v: Annotated[
        float, Meta(description="voltage: low end of the range; below it a reading is NaN")
    ] = 0.0
    max_v: Annotated[
        float, Meta(description="voltage: high end of the range; above it a reading is NaN")
    ] = 10.0
    terminals: Annotated[Terminals, Meta(description="voltage: how the input is wired")] = "default"
    resolution_bits: Annotated[
        int, Meta(gt=0, le=64, description="resolution of the converter, over the input range")
    ] = 24
    average: Annotated[
        int, Meta(ge=1, le=10_000, description="number of samples averaged for one reading")
    ] = 1
    sample_hz: (
        Annotated[
            float,
            Meta(
                gt=0,
                description="rate at which the device samples continuously; the newest "
                "samples are read; sampled on reading if left out",
            ),
        ]
        | None
    ) = None
    max_rate_hz: (
        Annotated[float, Meta(gt=0, description="highest rate of reads; measured if left out")]
        | None
    ) = None

    @property
    def scale(self) -> float:
        """Displacement [um] per unit of the input (V, or V/V)."""
        found = self.um_per_v if self.input == "voltage" else self.um_per_v_per_v
        assert found is not None
        return found

    @property
    def zero(self) -> float:
        """The input at displacement 0."""
        return self.zero_v if self.input == "voltage" else self.zero_v_per_v

    @property
    def ends(self) -> tuple[float, float]:
        """Low and high end of the input's range."""
        bridge = (-self.range_v_per_v, self.range_v_per_v)
        return (self.min_v, self.max_v) if self.input == "voltage" else bridge

    def check(self) -> None:
        """Refuse a scale of 0, which would hide every motion."""
        key = "um_per_v" if self.input == "voltage" else "um_per_v_per_v"
        if getattr(self, key) is None:
            raise self.wrong(key, f'given where input = "{self.input}"')
        if getattr(self, key) == 0:
            raise self.wrong(key, "a number other than 0")
        if not self.min_v < self.max_v:
            raise self.wrong("min_v", f"below max_v = {self.max_v:g}")
        if self.sample_hz is None and self.clock_source:
            raise self.wrong("clock_source", "left out where sample_hz is")
        if self.sample_hz is not None and self.average / self.sample_hz > self.timeout_s:
            raise self.wrong(
                "average", f"below sample_hz x timeout_s = {self.sample_hz * self.timeout_s:g}"
            )
