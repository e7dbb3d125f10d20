"""The recipes of docs/python-object.md, read from the page and run.

PIPython and pymeasure are the real packages, on a stand-in of the instrument. qcodes, pylablib and
pyepics are stand-ins with the names and signatures that the packages document.
"""

import re
import sys
import tomllib
from collections.abc import Iterator
from pathlib import Path
from types import ModuleType
from typing import Any, ClassVar

import pytest
from tests.drivers.python_object.gcs_unit import GcsUnit

from dehyst.drivers.interface import Actuator, DeviceGone, ProtocolError, Sensor
from dehyst.drivers.registry import load_actuator, load_sensor

PAGE = Path(__file__).parents[3] / "docs" / "python-object.md"


def recipe(title: str, language: str = "toml") -> str:
    """Return the code block of a recipe's section."""
    section = PAGE.read_text().split(f"### {title}\n")[1].split("\n## ")[0].split("\n### ")[0]
    found = re.search(rf"```{language}\n(.*?)```", section, re.S)
    assert found, title
    return found[1]


def devices(title: str, **others: Any) -> dict[str, Any]:
    """Return the recipe's drivers, opened. others: arguments that this machine needs."""
    table, made = tomllib.loads(recipe(title)), {}
    for kind, load in (("actuator", load_actuator), ("sensor", load_sensor)):
        if kind in table:
            settings = table[kind]["settings"]
            settings["arguments"] = {**settings["arguments"], **others}
            device = load(table[kind]["driver"]).from_settings(settings)
            assert isinstance(device, Actuator | Sensor)
            device.open()
            made[kind] = device
    return made


@pytest.fixture
def gcs_unit() -> Iterator[GcsUnit]:
    unit = GcsUnit()
    yield unit
    unit.stop()


@pytest.mark.processes
def test_pipython(gcs_unit: GcsUnit, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    pytest.importorskip("pipython")
    monkeypatch.syspath_prepend(str(tmp_path))
    (tmp_path / "pi_stage.py").write_text(recipe("PIPython", "python"))
    table = tomllib.loads(recipe("PIPython"))
    monkeypatch.delitem(sys.modules, "pi_stage", raising=False)
    assert table["actuator"]["settings"]["folder"] == table["sensor"]["settings"]["folder"]
    made = {}
    for kind, load in (("actuator", load_actuator), ("sensor", load_sensor)):
        settings = table[kind]["settings"] | {"folder": str(tmp_path)}
        settings["arguments"] = {"host": "127.0.0.1", "port": gcs_unit.port}
        made[kind] = load("python").from_settings(settings)
        made[kind].open()
    actuator, sensor = made["actuator"], made["sensor"]
    assert actuator.output() == 12.0
    assert "113012345" in actuator.spec.identity
    actuator.write(55.5)
    assert gcs_unit.volts == 55.5
    assert sensor.read() == pytest.approx(5.55)
    actuator.close()
    assert sensor.read() == pytest.approx(5.55)  # they share one connection
    sensor.close()


def test_pymeasure() -> None:
    adapters = pytest.importorskip("pymeasure.adapters")

    class SourceMeter(adapters.Adapter):
        """Answers the recipe's queries as a Keithley 2400 does."""

        volts = 1.0

        def _write(self, command: str, **kwargs: Any) -> None:
            self.asked = command
            if command.startswith(":SOURCE:VOLTAGE "):
                self.volts = float(command.split()[1])

        def _read(self, **kwargs: Any) -> str:
            answers = {":SOURCE:VOLTAGE?": f"{self.volts:.6e}"}
            return answers.get(self.asked, "KEITHLEY INSTRUMENTS INC.,MODEL 2400,1234567,C30")

    meter = SourceMeter()
    actuator = devices("pymeasure", adapter=meter)["actuator"]
    assert actuator.output() == 15.0
    assert "1234567" in actuator.spec.identity
    actuator.write(30.0)
    assert meter.volts == 2.0
    actuator.close()


class Parameter:
    """Stands in for a parameter of qcodes: a call with a value sets it, without one gets it."""

    def __init__(self) -> None:
        self.value = 2.0

    def __call__(self, *value: float) -> float | None:
        if not value:
            return self.value
        (self.value,) = value
        return None


def test_qcodes(monkeypatch: pytest.MonkeyPatch) -> None:
    class YokogawaGS200:
        names: ClassVar[set[str]] = set()

        def __init__(self, name: str, address: str) -> None:
            assert name not in self.names, "qcodes refuses a second instrument of a name"
            self.names.add(name)
            self.name, self.parameters = name, {"voltage": Parameter()}

        def __getattr__(self, name: str) -> Parameter:
            try:
                return self.parameters[name]  # qcodes delegates attributes like this
            except KeyError:
                raise AttributeError(name) from None

        def close(self) -> None:
            self.names.remove(self.name)

    package: Any = ModuleType("qcodes.instrument_drivers.yokogawa")
    package.YokogawaGS200 = YokogawaGS200
    for name in ("qcodes", "qcodes.instrument_drivers"):
        monkeypatch.setitem(sys.modules, name, ModuleType(name))
    monkeypatch.setitem(sys.modules, package.__name__, package)
    actuator = devices("qcodes")["actuator"]
    assert actuator.output() == 30.0
    actuator.write(45.0)
    actuator.reconnect()
    assert actuator.output() == 30.0  # the stand-in is made again, as reported
    actuator.close()
    assert not YokogawaGS200.names


def test_pylablib(monkeypatch: pytest.MonkeyPatch) -> None:
    class KinesisPiezoController:
        volts = 10.0

        def __init__(self, conn: str, timeout: float = 3.0) -> None:
            assert conn == "29000123"

        def set_output_voltage(self, voltage: float, channel: int | None = None) -> float:
            type(self).volts = voltage
            return voltage

        def get_output_voltage(self, channel: int | None = None) -> float:
            return self.volts

        def close(self) -> None:
            return None

    package: Any = ModuleType("pylablib.devices.Thorlabs")
    package.KinesisPiezoController = KinesisPiezoController
    for name in ("pylablib", "pylablib.devices"):
        monkeypatch.setitem(sys.modules, name, ModuleType(name))
    monkeypatch.setitem(sys.modules, package.__name__, package)
    actuator = devices("pylablib")["actuator"]
    assert (actuator.output(), actuator.spec.maximum) == (10.0, 75.0)
    actuator.write(70.0)
    assert KinesisPiezoController.volts == 70.0
    actuator.close()


def test_epics(monkeypatch: pytest.MonkeyPatch) -> None:
    values: dict[str, float | None] = {"LAB:PIEZO:VOLTS": 5.0, "LAB:PIEZO:POSITION": 0.5}

    class PV:
        def __init__(self, pvname: str) -> None:
            self.pvname = pvname

        def put(self, value: float, wait: bool = False) -> int | None:
            values[self.pvname] = value
            return 1

        def get(self, as_string: bool = False) -> float | None:
            return values[self.pvname]

    package: Any = ModuleType("epics")
    package.PV = PV
    monkeypatch.setitem(sys.modules, "epics", package)
    made = devices("EPICS process variables")
    actuator, sensor = made["actuator"], made["sensor"]
    assert actuator.output() == 5.0
    actuator.write(33.0)
    assert values["LAB:PIEZO:VOLTS"] == 33.0
    assert sensor.read() == 0.5
    values["LAB:PIEZO:POSITION"] = None  # what pyepics returns while it is not connected
    with pytest.raises(ProtocolError, match="get returned None"):
        sensor.read()
    sensor.close()
    with pytest.raises(DeviceGone):
        sensor.read()
