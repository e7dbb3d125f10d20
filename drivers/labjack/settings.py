"""The settings of the LabJack drivers."""

from typing import Annotated, Literal

from msgspec import Meta

from dehyst.drivers.analog import check_output_range
from dehyst.drivers.settings import Settings

MOST_AVERAGED = 14
"""Number of 4-byte values that fit into one 64-byte USB reply: one exchange per reading."""

INPUT_RANGES_V = (0.01, 0.1, 1.0, 10.0)  # of a T7


class LabjackSettings(Settings, frozen=True, kw_only=True):
    """Settings that identify the unit; an output and an input of one unit give the same values."""

    driver = "labjack"

    device: Annotated[Literal["ANY", "T4", "T7", "T8"], Meta(description="model of the unit")] = (
        "T7"
    )
    connection: Annotated[
        Literal["ANY", "USB", "TCP", "ETHERNET", "WIFI"], Meta(description="type of connection")
    ] = "ANY"
    identifier: Annotated[
        str, Meta(min_length=1, description="serial number, IP address or name; ANY: first found")
    ] = "ANY"
    timeout_s: Annotated[float, Meta(gt=0, le=10, description="time-out of one call")] = 0.2
    max_rate_hz: (
        Annotated[float, Meta(gt=0, description="highest rate of calls; measured if left out")]
        | None
    ) = None


class LabjackActuatorSettings(LabjackSettings, frozen=True, kw_only=True):
    """An analog output into the amplifier's EXT input; volts are volts at the piezo."""

    channel: Annotated[
        str, Meta(min_length=1, description='the output: "DAC0", or "TDAC0" of an LJTick-DAC')
    ] = "DAC0"
    gain: Annotated[
        float, Meta(description="volts at the piezo per volt at EXT, not 0; negative if inverting")
    ] = 15.0
    zero_v: Annotated[float, Meta(description="volts at EXT where the piezo has 0 V")] = 0.0
    min_v: Annotated[float, Meta(description="lowest voltage at the piezo")] = 0.0
    max_v: Annotated[float, Meta(description="highest voltage at the piezo")] = 75.0
    device_min_v: Annotated[float, Meta(description="lowest voltage of the unit's output")] = 0.0
    device_max_v: Annotated[
        float, Meta(description="highest voltage of the unit's output; TDAC, T8: 10")
    ] = 5.0
    resolution_bits: Annotated[
        int, Meta(gt=0, le=64, description="resolution of the converter, over the unit's range")
    ] = 12
    initial_v: (
        Annotated[
            float,
            Meta(description="voltage at the piezo at start; only for a TDAC"),
        ]
        | None
    ) = None

    @property
    def reports(self) -> bool:
        """Whether the output voltage can be queried."""
        return self.channel.upper().startswith("DAC")

    def check(self) -> None:
        """Refuse a range that EXT cannot reach."""
        check_output_range(self, self.channel)
        if self.reports and self.initial_v is not None:
            raise self.wrong("initial_v", f"left out; {self.channel} reports its own output")
        if not self.reports and not (
            self.initial_v is not None and self.min_v <= self.initial_v <= self.max_v
        ):
            raise self.wrong(
                "initial_v", f"from {self.min_v:g} to {self.max_v:g}; {self.channel} reports none"
            )


class LabjackSensorSettings(LabjackSettings, frozen=True, kw_only=True):
    """An analog input: the voltage of a monitor, a probe or an interferometer."""

    channel: Annotated[str, Meta(min_length=1, description='the input, e.g. "AIN0"')] = "AIN0"
    um_per_v: Annotated[
        float, Meta(description="displacement per volt, not 0; a negative value reverses it")
    ]
    zero_v: Annotated[float, Meta(description="volts at displacement 0")] = 0.0
    min_v: Annotated[float, Meta(description="low end of the range; below it a reading is NaN")] = (
        0.0
    )
    max_v: Annotated[
        float, Meta(description="high end of the range; above it a reading is NaN")
    ] = 10.0
    range_v: Annotated[
        float, Meta(description="range of the unit's amplifier on either side: 0.01, 0.1, 1 or 10")
    ] = 10.0
    negative: Annotated[
        Literal["GND", "AIN1", "AIN3", "AIN5", "AIN7", "AIN9", "AIN11", "AIN13"],
        Meta(description="negative input: GND, or an input for a differential measurement"),
    ] = "GND"
    resolution_index: Annotated[
        int,
        Meta(ge=0, le=12, description="oversampling of the unit, see its manual; 0: its default"),
    ] = 0
    settling_s: Annotated[
        float,
        Meta(ge=0, le=0.05, description="settling time before a sample; 0: the unit's choice"),
    ] = 0.0
    average: Annotated[
        int,
        Meta(ge=1, le=MOST_AVERAGED, description="number of samples averaged for one reading"),
    ] = 1
    resolution_bits: Annotated[
        int, Meta(gt=0, le=64, description="resolution of the converter, over range_v")
    ] = 16

    def check(self) -> None:
        """Refuse a scale of 0, which would hide every motion."""
        if self.um_per_v == 0:
            raise self.wrong("um_per_v", "a number other than 0")
        if not self.min_v < self.max_v:
            raise self.wrong("min_v", f"below max_v = {self.max_v:g}")
        if self.range_v not in INPUT_RANGES_V:
            raise self.wrong("range_v", "0.01, 0.1, 1 or 10")
        if max(abs(self.min_v), abs(self.max_v)) > self.range_v:
            raise self.wrong("range_v", "at least as wide as min_v to max_v")
