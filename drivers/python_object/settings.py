"""The settings of Python objects that are used as devices."""

from typing import Annotated, Any

from msgspec import Meta

from dehyst.drivers.settings import Settings

Fixed = tuple[str | int | float, ...]


class PythonSettings(Settings, frozen=True, kw_only=True):
    """Settings of both kinds of device."""

    driver = "python"

    object: Annotated[
        str, Meta(min_length=3, description='"module:factory", called to make the object')
    ]
    arguments: Annotated[dict[str, Any], Meta(description="named arguments of the factory")] = {}  # noqa: RUF012 a frozen struct makes a new one each time
    folder: Annotated[str, Meta(description="folder of the module, where it is not installed")] = ""
    serial_number: Annotated[
        str, Meta(description="method or attribute that gives the unit's serial number")
    ] = ""
    close: Annotated[str, Meta(description="method that releases the unit")] = ""
    max_rate_hz: (
        Annotated[float, Meta(gt=0, description="highest rate of calls; measured if left out")]
        | None
    ) = None

    def check(self) -> None:
        """Require the object's name in the form of a module and a name in it."""
        module, colon, factory = self.object.partition(":")
        names = [*module.split("."), *factory.split(".")]
        if not colon or not all(name.isidentifier() for name in names):
            raise self.wrong("object", 'written as "module:factory"')


class PythonActuatorSettings(PythonSettings, frozen=True, kw_only=True):
    """An object that sets a voltage; volts are volts at the piezo."""

    write: Annotated[str, Meta(min_length=1, description="method to call, or attribute to set")]
    write_arguments: Annotated[
        Fixed, Meta(description="arguments before the value, e.g. an axis or a channel")
    ] = ()
    output: Annotated[
        str,
        Meta(description="method or attribute that gives the set-point; it is timed at the start"),
    ] = ""
    output_arguments: Annotated[Fixed, Meta(description="arguments of output")] = ()
    gain: Annotated[float, Meta(gt=0, description="volts at the piezo per unit written")] = 1.0
    min_v: Annotated[float, Meta(description="lowest voltage at the piezo")] = 0.0
    max_v: Annotated[float, Meta(description="highest voltage at the piezo")]
    step_v: Annotated[float, Meta(ge=0, description="step of the voltage at the piezo")] = 0.0
    initial_v: (
        Annotated[float, Meta(description="voltage at the piezo at start, where output is not set")]
        | None
    ) = None

    def check(self) -> None:
        """Require a range, a known output, and a known rate."""
        super().check()
        if not self.min_v < self.max_v:
            raise self.wrong("min_v", f"below max_v = {self.max_v:g}")
        if not self.step_v < self.max_v - self.min_v:
            raise self.wrong("step_v", "smaller than the range")
        if self.output and self.initial_v is not None:
            raise self.wrong("initial_v", "left out where output is named, which is read instead")
        if not self.output:
            if self.initial_v is None or not self.min_v <= self.initial_v <= self.max_v:
                raise self.wrong(
                    "initial_v", f"from {self.min_v:g} to {self.max_v:g}, as output is not named"
                )
            if self.max_rate_hz is None:
                raise self.wrong("max_rate_hz", "given; without output no call can be timed")


class PythonSensorSettings(PythonSettings, frozen=True, kw_only=True):
    """An object that reads a displacement."""

    read: Annotated[str, Meta(min_length=1, description="method to call, or attribute to read")]
    read_arguments: Annotated[
        Fixed, Meta(description="its arguments, e.g. an axis or a channel")
    ] = ()
    um_per_unit: Annotated[
        float, Meta(description="displacement per unit read, not 0; a negative value reverses it")
    ] = 1.0
    zero: Annotated[float, Meta(description="what is read at displacement 0")] = 0.0
    min_um: Annotated[float, Meta(description="lowest displacement; below it a reading is NaN")]
    max_um: Annotated[float, Meta(description="highest displacement; above it a reading is NaN")]
    step_um: Annotated[float, Meta(ge=0, description="step of a reading")] = 0.0

    def check(self) -> None:
        """Require a range and a scale."""
        super().check()
        if self.um_per_unit == 0:
            raise self.wrong("um_per_unit", "a number other than 0")
        if not self.min_um < self.max_um:
            raise self.wrong("min_um", f"below max_um = {self.max_um:g}")
        if not self.step_um < self.max_um - self.min_um:
            raise self.wrong("step_um", "smaller than the range")
