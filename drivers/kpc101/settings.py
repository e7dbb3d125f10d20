"""The settings of the KPC101 and BPC303 drivers, for an output and for a gauge."""

from typing import Annotated

from msgspec import Meta

from dehyst.drivers.apt.settings import AptSettings, PiezoSettings

Channel = Annotated[int, Meta(ge=1, le=3, description="channel of the unit, counted from 1")]


class Kpc101Settings(PiezoSettings, frozen=True):
    """Settings of the only output."""

    driver = "kpc101"


class Bpc303Settings(PiezoSettings, frozen=True):
    """Settings of one of three outputs."""

    driver = "bpc303"

    channel: Channel = 1


class Kpc101SensorSettings(AptSettings, frozen=True):
    """Settings of the only gauge."""

    driver = "kpc101"

    max_travel_um: Annotated[
        float, Meta(ge=0, description="travel at 100 %; 0: as reported by the unit")
    ] = 0.0


class Bpc303SensorSettings(Kpc101SensorSettings, frozen=True):
    """Settings of one of three gauges."""

    driver = "bpc303"

    channel: Channel = 1
