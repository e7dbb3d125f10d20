"""The settings of the IIO drivers."""

from typing import Annotated

from msgspec import Meta

from dehyst.drivers.settings import Settings

FIRST_DEVICE = "/sys/bus/iio/devices/iio:device0"


class IioSettings(Settings, frozen=True):
    """Settings of both kinds of channel."""

    driver = "iio"

    path: Annotated[str, Meta(min_length=1, description="the device's folder")] = FIRST_DEVICE
    channel: Annotated[
        str,
        Meta(min_length=1, description='"voltage0", or "voltage0-voltage1" (differential)'),
    ] = "voltage0"

    def check(self) -> None:
        """Refuse a channel that is a path: it must be in the device's folder."""
        if "/" in self.channel:
            raise self.wrong("channel", "a name and no path")


class IioSensorSettings(IioSettings, frozen=True):
    """A converter channel on a strain-gauge bridge."""

    um_per_mv: Annotated[
        float, Meta(description="displacement per millivolt, not 0; a negative value reverses it")
    ] = 1.0
    zero_mv: Annotated[float, Meta(description="voltage at displacement 0")] = 0.0
    bits: Annotated[int, Meta(ge=8, le=32, description="of the converter")] = 24
    unsigned: Annotated[
        bool, Meta(description="raw counts begin at 0; otherwise two's complement")
    ] = False

    def check(self) -> None:
        """Refuse a scale of 0, which would hide every motion."""
        super().check()
        if self.um_per_mv == 0:
            raise self.wrong("um_per_mv", "a number other than 0")


class IioActuatorSettings(IioSettings, frozen=True):
    """A converter channel into the amplifier's analog input; volts are volts at the piezo."""

    gain: Annotated[
        float, Meta(gt=0, description="volts at the piezo per volt at the converter's output")
    ] = 15.0
    min_v: Annotated[float, Meta(description="lowest voltage at the piezo")] = 0.0
    max_v: Annotated[float, Meta(description="highest voltage at the piezo")] = 150.0
    bits: Annotated[int, Meta(ge=8, le=32, description="of the converter")] = 16
    unsigned: Annotated[
        bool, Meta(description="raw counts begin at 0; otherwise two's complement")
    ] = True
    max_rate_hz: Annotated[float, Meta(gt=0, description="highest rate of writes")] = 1000.0

    def check(self) -> None:
        """Refuse an empty range."""
        super().check()
        if not self.min_v < self.max_v:
            raise self.wrong("min_v", f"below max_v = {self.max_v:g}")
