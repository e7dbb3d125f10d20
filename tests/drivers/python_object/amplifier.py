"""A vendor's Python package for the tests: one amplifier with a gauge."""

from typing import Any, ClassVar


class Unit:
    """The device shared by every object of this module. calls_s: how long a call lasts."""

    volts = 20.0
    plugged = True
    serial = "A7"
    made = 0
    closed = 0
    raises: ClassVar[type[Exception]] = OSError


class Amplifier:
    """voltage: as a property; set_voltage, get_position: as methods with a channel."""

    def __init__(self, port: str = "COM3") -> None:
        self._check()
        Unit.made += 1
        self.port = port
        self.channel = self
        self.kind = "unit of tests"

    def _check(self) -> None:
        if not Unit.plugged:
            raise Unit.raises("no such device\non this bus")

    @property
    def voltage(self) -> float:
        self._check()
        return Unit.volts

    @voltage.setter
    def voltage(self, value: float) -> None:
        self._check()
        Unit.volts = value

    def set_voltage(self, channel: int, volts: float) -> None:
        self._check()
        assert channel == 2
        Unit.volts = volts

    def get_voltage(self) -> list[float]:
        return [self.voltage]

    def get_positions(self, *axes: str) -> dict[str, float]:
        self._check()
        return dict.fromkeys(axes, 1000.0 + 50.0 * Unit.volts)

    def get_serial(self) -> str:
        self._check()
        return Unit.serial

    async def set_later(self, volts: float) -> None:
        Unit.volts = volts

    def nothing(self, *arguments: Any) -> None:
        return None

    def flag(self) -> bool:
        return True

    def shut(self) -> None:
        self._check()
        Unit.closed += 1


def fails(**arguments: Any) -> Amplifier:
    raise RuntimeError(f"no licence for {sorted(arguments)}")


def gives_nothing() -> None:
    return None
