"""The settings of the KSG101 driver."""

from typing import Annotated

from msgspec import Meta

from dehyst.drivers.settings import Settings


class Ksg101Settings(Settings, frozen=True):
    """Settings of one reader."""

    driver = "ksg101"

    port: Annotated[
        str,
        Meta(min_length=1, description='path of the serial port; "auto": the one APT unit on USB'),
    ] = "auto"
    max_travel_um: Annotated[
        float, Meta(ge=0, description="what 100 % means; 0: the unit is asked")
    ] = 0.0
    calibration: Annotated[
        float,
        Meta(description="factor on the reading, not 0: some units' display and protocol differ"),
    ] = 1.0
    smoothed: Annotated[bool, Meta(description="take the unit's own smoothed reading")] = False
    timeout_s: Annotated[float, Meta(gt=0, le=10, description="longest wait for a reply")] = 0.1
    rtscts: Annotated[bool, Meta(description="RTS/CTS flow control on the serial line")] = False

    serial_number: Annotated[str, Meta(description="accept only this unit")] | None = None

    def check(self) -> None:
        """A factor of 0 would hide every motion."""
        if self.calibration == 0:
            raise self.wrong("calibration", "a number other than 0")
