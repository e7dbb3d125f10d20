"""Properties of the emulated KPZ101, and the faults that can be switched at run time."""

from typing import Annotated, Literal

from msgspec import Meta

from dehyst.drivers.emulated.apt_unit import AptFaults, AptKnobs


class Kpz101Knobs(AptKnobs, frozen=True):
    """Properties of the unit; the defaults are plausible."""

    driver = "emulated kpz101"

    serial_number: Annotated[int, Meta(ge=0, description="serial number that the unit reports")] = (
        29000123
    )
    model: Annotated[str, Meta(max_length=8, description="model that the unit reports")] = "KPZ101"
    limit_v: Annotated[Literal[75, 100, 150], Meta(description="the unit's voltage limit [V]")] = (
        150
    )
    start_v: Annotated[float, Meta(ge=0, le=150, description="set-point at power-on [V]")] = 0.0
    enabled: Annotated[bool, Meta(description="the output is enabled at power-on")] = False
    mode: Annotated[int, Meta(ge=1, le=4, description="position control mode; 1: open loop")] = 1
    source: Annotated[int, Meta(ge=0, le=3, description="voltage source; 0: software only")] = 0

    def check(self) -> None:
        """Refuse a set-point beyond the limit."""
        if self.start_v > self.limit_v:
            raise self.wrong("start_v", f"at most limit_v = {self.limit_v}")


class Kpz101Faults(AptFaults, frozen=True):
    """Faults at run time."""

    driver = "emulated kpz101's faults"

    stuck: Annotated[bool, Meta(description="sets are not carried out")] = False
