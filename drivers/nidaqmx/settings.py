"""The settings of the NI-DAQmx drivers."""

from typing import Annotated

from msgspec import Meta

from dehyst.drivers.settings import Settings

RATE_HZ = 1000.0
EXT_V = 10.0  # the output has -10 to 10 V
TIMEOUT_S = 0.2


class NidaqmxActuatorSettings(Settings, frozen=True):
    """An analog output into the amplifier's EXT input; volts are volts at the piezo."""

    driver = "nidaqmx"

    channel: Annotated[str, Meta(min_length=1, description='the output, e.g. "Dev1/ao0"')]
    gain: Annotated[float, Meta(gt=0, description="volts at the piezo per volt at EXT")] = 15.0
    min_v: Annotated[float, Meta(description="lowest voltage at the piezo")] = 0.0
    max_v: Annotated[float, Meta(description="highest voltage at the piezo")] = 150.0
    resolution_bits: Annotated[
        int, Meta(gt=0, le=64, description="of the converter, over its -10 to 10 V")
    ] = 16
    initial_v: Annotated[
        float,
        Meta(description="voltage at the piezo at start: the hardware cannot be asked"),
    ] = 0.0
    timeout_s: Annotated[float, Meta(gt=0, le=10, description="longest time of one write")] = (
        TIMEOUT_S
    )
    max_rate_hz: Annotated[
        float, Meta(gt=0, description="highest rate of writes, each on demand")
    ] = RATE_HZ

    def check(self) -> None:
        """The range must be one that EXT reaches."""
        ends = (self.min_v / self.gain, self.max_v / self.gain)
        if not self.min_v < self.max_v:
            raise self.wrong("min_v", f"below max_v = {self.max_v:g}")
        for key, volts in zip(("min_v", "max_v"), ends, strict=True):
            if abs(volts) > EXT_V:
                raise self.wrong(
                    key, f"within the -10 to 10 V of EXT; at gain {self.gain:g} it is {volts:g} V"
                )
        if not self.min_v <= self.initial_v <= self.max_v:
            raise self.wrong("initial_v", f"from {self.min_v:g} to {self.max_v:g}")


class NidaqmxSensorSettings(Settings, frozen=True):
    """A full bridge of strain gauges."""

    driver = "nidaqmx"

    channel: Annotated[str, Meta(min_length=1, description='the input, e.g. "cDAQ1Mod1/ai0"')]
    um_per_v_per_v: Annotated[
        float, Meta(description="displacement per bridge ratio, not 0; below 0 turns it round")
    ]
    zero_v_per_v: Annotated[float, Meta(description="bridge ratio at displacement 0")] = 0.0
    excitation_v: Annotated[float, Meta(gt=0, description="supply of the bridge")] = 2.5
    range_v_per_v: Annotated[
        float, Meta(gt=0, description="input range on either side; beyond it a reading is NaN")
    ] = 0.025
    resolution_bits: Annotated[
        int, Meta(gt=0, le=64, description="of the converter, over the input range")
    ] = 24
    timeout_s: Annotated[float, Meta(gt=0, le=10, description="longest time of one read")] = (
        TIMEOUT_S
    )
    max_rate_hz: Annotated[
        float, Meta(gt=0, description="highest rate of reads, each on demand")
    ] = RATE_HZ

    def check(self) -> None:
        """A scale of 0 would hide every motion."""
        if self.um_per_v_per_v == 0:
            raise self.wrong("um_per_v_per_v", "a number other than 0")
