"""How the emulated KSG101 is built, and the faults that can be switched while it runs."""

from typing import Annotated

from msgspec import Meta

from dehyst.drivers.settings import Settings


class Ksg101Knobs(Settings, frozen=True):
    """The unit; the defaults are a plausible one."""

    driver = "emulated ksg101"

    serial_number: Annotated[int, Meta(ge=0, description="what the unit calls itself")] = 59000123
    model: Annotated[str, Meta(max_length=8, description="what the unit is")] = "KSG101"
    max_travel_um: Annotated[
        float, Meta(gt=0, le=6553.5, description="what 100 % means, in steps of 0.1 um")
    ] = 20.0
    scale_error: Annotated[
        float, Meta(description="readings are this much too large, as on some units")
    ] = 1.0
    latency_s: Annotated[float, Meta(ge=0, description="from a request to its reply")] = 0.0002
    smoothing_s: Annotated[
        float, Meta(gt=0, description="time constant of the smoothed reading")
    ] = 0.05
    chunk_size: Annotated[int, Meta(ge=0, description="bytes per write; 0: whole")] = 0
    seed: Annotated[int, Meta(description="of the garbage")] = 0


class Ksg101Faults(Settings, frozen=True):
    """Faults while the unit runs."""

    driver = "emulated ksg101's faults"

    mute: Annotated[bool, Meta(description="no replies")] = False
    delay_s: Annotated[float, Meta(ge=0, description="replies come this much later")] = 0.0
    garbage: Annotated[
        int, Meta(ge=0, description="this number of replies have random bytes before them")
    ] = 0
    stuck: Annotated[bool, Meta(description="always the same reading")] = False
