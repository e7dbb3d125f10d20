"""Settings that the drivers of APT units have in common."""

from typing import Annotated, Literal

from msgspec import Meta

from dehyst.drivers.settings import Settings


class AptSettings(Settings, frozen=True):
    """The port of a unit."""

    driver = "APT unit"

    port: Annotated[
        str,
        Meta(min_length=1, description='path of the serial port; "auto": the one such unit on USB'),
    ] = "auto"
    timeout_s: Annotated[float, Meta(gt=0, le=10, description="longest wait for a reply")] = 0.1
    rtscts: Annotated[bool, Meta(description="RTS/CTS flow control on the serial line")] = False
    serial_number: Annotated[str, Meta(description="accept only this unit")] | None = None


class PiezoSettings(AptSettings, frozen=True):
    """One output of a piezo driver."""

    driver = "APT piezo driver"

    limit_v: (
        Annotated[
            Literal[75, 100, 150],
            Meta(
                description="voltage limit that the unit must have [V]; if left out, "
                "any of the three"
            ),
        ]
        | None
    ) = None
    max_v: (
        Annotated[
            float,
            Meta(
                gt=0, le=150, description="upper limit of the output, at most the unit's limit [V]"
            ),
        ]
        | None
    ) = None

    def check(self) -> None:
        """Refuse a range beyond the required voltage limit, which it could never reach."""
        if self.limit_v is not None and self.max_v is not None and self.max_v > self.limit_v:
            raise self.wrong("max_v", f"at most limit_v = {self.limit_v}")
