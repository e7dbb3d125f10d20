"""The settings of the KSG101 driver."""

from typing import Annotated

from msgspec import Meta

from dehyst.drivers.apt.settings import AptSettings


class Ksg101Settings(AptSettings, frozen=True):
    """Settings of one reader."""

    driver = "ksg101"

    max_travel_um: Annotated[
        float, Meta(ge=0, description="travel at 100 %; 0: as reported by the unit")
    ] = 0.0
    calibration: Annotated[
        float,
        Meta(description="factor on the reading, not 0; some units' display and protocol differ"),
    ] = 1.0
    smoothed: Annotated[bool, Meta(description="use the unit's own smoothed reading")] = False

    def check(self) -> None:
        """Refuse a factor of 0, which would hide every motion."""
        if self.calibration == 0:
            raise self.wrong("calibration", "a number other than 0")
