"""Properties of the emulated KSG101, and the faults that can be switched at run time."""

from typing import Annotated

from msgspec import Meta

from dehyst.drivers.emulated.apt_unit import AptFaults, AptKnobs


class Ksg101Knobs(AptKnobs, frozen=True):
    """Properties of the unit; the defaults are plausible."""

    driver = "emulated ksg101"

    serial_number: Annotated[int, Meta(ge=0, description="serial number that the unit reports")] = (
        59000123
    )
    model: Annotated[str, Meta(max_length=8, description="model that the unit reports")] = "KSG101"
    max_travel_um: Annotated[
        float, Meta(gt=0, le=6553.5, description="travel at 100 %, in steps of 0.1 um")
    ] = 20.0
    scale_error: Annotated[
        float, Meta(description="readings are this much too large, as on some units")
    ] = 1.0
    smoothing_s: Annotated[
        float, Meta(gt=0, description="time constant of the smoothed reading")
    ] = 0.05


class Ksg101Faults(AptFaults, frozen=True):
    """Faults at run time."""

    driver = "emulated ksg101's faults"

    stuck: Annotated[bool, Meta(description="always the same reading")] = False
