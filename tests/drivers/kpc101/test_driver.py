"""The drivers of KPC101, BPC301 and BPC303, outputs and gauges, with their emulators on ptys."""

import math
import os
import shutil
import tempfile
from collections.abc import Callable, Iterator
from contextlib import suppress
from pathlib import Path
from typing import ClassVar

import pytest

from dehyst.daemon.setup.units import ask_port, gauge_beside
from dehyst.drivers.contract import ActuatorContract, SensorContract
from dehyst.drivers.emulated.kpc101_unit import (
    RACK_KNOBS,
    Bpc303Unit,
    Kpc101Faults,
    Kpc101Knobs,
    Kpc101Unit,
)
from dehyst.drivers.emulated.kpz101_unit import Kpz101Unit
from dehyst.drivers.emulated.pty_device import PtyServer
from dehyst.drivers.interface import (
    DeviceTimeout,
    DriverConfigError,
    DriverError,
    ForeignUnit,
    ProtocolError,
    UnitIdentity,
)
from dehyst.drivers.kpc101 import Bpc303, Bpc303Sensor, Kpc101, Kpc101Sensor
from dehyst.drivers.kpz101 import Kpz101

PATIENCE_S = 5.0
UM_PER_V = 0.1


class Rig:
    """An emulated unit on a pty. Each channel's stage follows only its own voltage."""

    def __init__(self, folder: Path, rack: bool = False, **knobs: object) -> None:
        self.outputs_v: dict[int, list[float]] = {1: [], 2: [], 3: []}
        base = RACK_KNOBS if rack else Kpc101Knobs()
        made = Kpc101Knobs(**{"serial_number": base.serial_number, "model": base.model, **knobs})
        kind: type[Bpc303Unit] | type[Kpc101Unit] = Bpc303Unit if rack else Kpc101Unit
        self.unit = kind(made, self._drive, self._position)
        self.server = PtyServer(self.unit, folder / "unit")
        self.server.start()

    def _drive(self, channel: int, volts: float, time_s: float) -> None:
        self.outputs_v[channel].append(volts)

    def _position(self, channel: int, time_s: float) -> float:
        return UM_PER_V * ([0.0, *self.outputs_v[channel]])[-1]

    def settings(self, **more: object) -> dict[str, object]:
        return {"port": self.server.port, "timeout_s": PATIENCE_S, **more}

    def fault(self, **faults: object) -> None:
        self.server.call(lambda: setattr(self.unit, "faults", Kpc101Faults(**faults)))  # type: ignore[arg-type]


Make = Callable[..., Rig]


def both_roles(rig: Rig) -> tuple[Kpc101, Kpc101Sensor]:
    """Return the opened output and gauge of one unit."""
    output = Kpc101.from_settings(rig.settings())
    gauge = Kpc101Sensor.from_settings(rig.settings())
    output.open()
    gauge.open()
    return output, gauge


@pytest.fixture
def make(tmp_path: Path) -> Iterator[Make]:
    made: list[Rig] = []

    def one(**knobs: object) -> Rig:
        made.append(Rig(tmp_path, **knobs))  # type: ignore[arg-type]
        return made[-1]

    yield one
    for rig in made:
        rig.server.stop()


class _OnAUnit:
    """The fixtures that the contracts of outputs and gauges need."""

    rack: ClassVar[bool] = False

    def setup_method(self) -> None:
        self.folder = Path(tempfile.mkdtemp())
        self.rig = Rig(self.folder, self.rack)

    def teardown_method(self) -> None:
        self.rig.server.stop()
        shutil.rmtree(self.folder)

    def unplug(self, device: object) -> None:
        self.rig.server.unplug()

    def replug(self, device: object) -> None:
        self.rig.server.plug()


class TestKpc101Contract(_OnAUnit, ActuatorContract):
    def make(self) -> Kpc101:
        return Kpc101.from_settings(self.rig.settings())

    def true_output(self, device: Kpc101) -> float:
        return self.rig.server.call(lambda: self.rig.unit.output_v())


class TestBpc303Contract(_OnAUnit, ActuatorContract):
    rack = True

    def make(self) -> Bpc303:
        return Bpc303.from_settings(self.rig.settings(channel=2))

    def true_output(self, device: Bpc303) -> float:
        return self.rig.server.call(lambda: self.rig.unit.output_v("y"))


class TestKpc101SensorContract(_OnAUnit, SensorContract):
    tolerance = 20.0 / 32767

    def make(self) -> Kpc101Sensor:
        return Kpc101Sensor.from_settings(self.rig.settings())

    def true_value(self, device: Kpc101Sensor) -> float:
        self.rig.server.call(lambda: self.rig.outputs_v[1].append(37.0))
        return UM_PER_V * 37.0


class TestBpc303SensorContract(TestKpc101SensorContract):
    rack = True

    def make(self) -> Kpc101Sensor:
        return Bpc303Sensor.from_settings(self.rig.settings(channel=1))


@pytest.mark.parametrize("model", ["KPC101", "BPC301"])
def test_output_and_gauge_share_one_port(make: Make, model: str) -> None:
    rig = make(model=model, limit_v=75)
    output = Kpc101.from_settings(rig.settings(limit_v=75))
    gauge = Kpc101Sensor.from_settings(rig.settings())
    output.open()
    gauge.open()
    assert output.spec.identity == f"{model} serial 113000123 firmware 1.0.3 limit 75 V"
    for volts in (10.0, 60.0):
        output.write(volts)
        assert gauge.read() == pytest.approx(UM_PER_V * volts, abs=2e-3)
    output.close()
    assert gauge.read() == pytest.approx(6.0, abs=2e-3)  # the port stays open for the gauge
    gauge.close()
    with pytest.raises(DriverError):
        gauge.read()


def test_each_channel_of_a_rack_is_its_own(make: Make) -> None:
    rig = make(rack=True)
    outputs = [Bpc303.from_settings(rig.settings(channel=n)) for n in (1, 2, 3)]
    gauges = [Bpc303Sensor.from_settings(rig.settings(channel=n)) for n in (1, 2, 3)]
    for device in (*outputs, *gauges):
        device.open()
    for n, output in enumerate(outputs, 1):
        output.write(20.0 * n)
    assert {n: v[-1] for n, v in rig.outputs_v.items()} == {
        n: pytest.approx(20.0 * n, abs=5e-3) for n in (1, 2, 3)
    }
    assert [g.read() for g in gauges] == [pytest.approx(2.0 * n, abs=2e-3) for n in (1, 2, 3)]
    assert "BPC303 serial 71000123 firmware 1.0.3 channel 3 " in outputs[2].spec.identity
    for device in (*outputs, *gauges):
        device.close()


def test_one_role_that_finds_the_unit_gone_does_not_stop_the_other(make: Make) -> None:
    rig = make()
    output, gauge = both_roles(rig)
    output.write(30.0)
    rig.server.unplug()
    with pytest.raises(DriverError):
        gauge.read()
    rig.server.plug()
    gauge.reconnect()
    assert gauge.read() == pytest.approx(3.0, abs=2e-3)
    with pytest.raises(DriverError):  # its own link is the old one
        output.write(31.0)
    output.reconnect()
    assert output.output() == pytest.approx(30.0, abs=5e-3)
    output.write(32.0)
    assert gauge.read() == pytest.approx(3.2, abs=2e-3)
    output.close()
    gauge.close()


@pytest.mark.skipif(not Path("/proc/self/fd").is_dir(), reason="lists open files in /proc")
def test_a_dead_port_is_closed_for_both_roles(make: Make) -> None:
    """A port that stays open keeps its name, and the unit comes back under another."""
    rig = make()
    output, gauge = both_roles(rig)
    port = os.path.realpath(rig.server.port)
    assert holds(port)
    rig.server.unplug()
    with pytest.raises(DriverError):
        gauge.read()
    assert not holds(port)
    output.close()
    gauge.close()


def holds(port: str) -> bool:
    """Return whether this process has the port open."""
    for file in Path("/proc/self/fd").iterdir():
        with suppress(OSError):
            if os.readlink(file).startswith(port):
                return True
    return False


def test_an_empty_bay_is_named(make: Make) -> None:
    rig = make(rack=True, bays=2)
    with pytest.raises(DriverConfigError, match="bay of channel 3 is empty"):
        Bpc303.from_settings(rig.settings(channel=3)).open()
    with pytest.raises(DriverConfigError, match="bay of channel 3 is empty"):
        Bpc303Sensor.from_settings(rig.settings(channel=3)).open()


def test_a_channel_without_a_gauge_is_no_sensor(make: Make) -> None:
    rig = make(gauge=False)
    with pytest.raises(DriverConfigError, match="no strain gauge is connected to channel 1"):
        Kpc101Sensor.from_settings(rig.settings()).open()


def test_a_gauge_that_is_pulled_or_at_full_scale_reads_nothing(make: Make) -> None:
    rig = make()
    gauge = Kpc101Sensor.from_settings(rig.settings())
    gauge.open()
    rig.server.call(lambda: setattr(rig.unit, "gauge_connected", False))
    assert math.isnan(gauge.read())
    rig.server.call(lambda: setattr(rig.unit, "gauge_connected", True))
    assert gauge.read() == 0.0
    rig.server.call(lambda: rig.outputs_v[1].append(1000.0))  # 100 um of 20
    assert math.isnan(gauge.read())
    gauge.close()


def test_a_unit_that_does_not_know_its_travel(make: Make) -> None:
    rig = make(max_travel_um=0.0)
    with pytest.raises(DriverConfigError, match="set max_travel_um"):
        Kpc101Sensor.from_settings(rig.settings()).open()
    gauge = Kpc101Sensor.from_settings(rig.settings(max_travel_um=40.0))
    gauge.open()
    assert gauge.spec.maximum == 40.0
    gauge.close()


def test_roles_that_want_the_port_differently_are_refused(make: Make) -> None:
    rig = make()
    gauge = Kpc101Sensor.from_settings(rig.settings())
    gauge.open()
    with pytest.raises(DriverConfigError, match="the same timeout_s and rtscts"):
        Kpc101.from_settings(rig.settings(timeout_s=4.0)).open()
    assert gauge.read() == 0.0
    gauge.close()


@pytest.mark.parametrize("rack", [False, True])
def test_a_unit_in_closed_loop_is_not_driven(make: Make, rack: bool) -> None:
    rig = make(rack=rack, mode=2, enabled=True)
    with pytest.raises(DriverConfigError, match="set it to open loop"):
        (Bpc303 if rack else Kpc101).from_settings(rig.settings()).open()
    assert rig.outputs_v == {1: [], 2: [], 3: []}


def test_another_limit_is_refused(make: Make) -> None:
    rig = make(limit_v=150)
    with pytest.raises(DriverConfigError, match="limit is 150 V, but limit_v is 75 V"):
        Kpc101.from_settings(rig.settings(limit_v=75)).open()
    assert rig.outputs_v[1] == []


def test_foreign_units_get_no_voltage(make: Make) -> None:
    rig = make()
    with pytest.raises(ForeignUnit, match="'KPC101', but the configuration asks for a KPZ101"):
        Kpz101.from_settings(rig.settings()).open()
    known = Kpc101.from_settings(rig.settings())
    known.expect(UnitIdentity("113000124"))
    with pytest.raises(ForeignUnit, match="113000123"):
        known.open()
    with pytest.raises(DeviceTimeout):  # there is no unit at a motherboard's address
        Bpc303.from_settings(rig.settings(timeout_s=0.2)).open()
    other = Kpz101Unit()
    rig.server.call(lambda: setattr(rig.server, "unit", other))
    with pytest.raises(
        ForeignUnit, match="'KPZ101', but the configuration asks for a KPC101 or BPC301"
    ):
        Kpc101Sensor.from_settings(rig.settings()).open()
    assert (rig.outputs_v[1], other.sets_done) == ([], 0)


@pytest.mark.parametrize("rack", [False, True])
def test_garbage_and_sets_that_are_not_carried_out(make: Make, rack: bool) -> None:
    rig = make(rack=rack, chunk_size=3)
    output = (Bpc303 if rack else Kpc101).from_settings(rig.settings())
    output.open()
    rig.fault(garbage=5)
    for n in range(1, 6):
        output.write(float(n))
        assert rig.outputs_v[1][-1] == pytest.approx(n, abs=output.spec.resolution)
    rig.fault(stuck=True)
    with pytest.raises(ProtocolError, match=r"set to 20\.\d* V but reports"):
        output.write(20.0)
    assert output.output() == pytest.approx(5.0, abs=output.spec.resolution)
    output.close()


@pytest.mark.parametrize("rack", [False, True])
def test_a_late_position_is_not_taken_for_the_next_one(make: Make, rack: bool) -> None:
    rig = make(rack=rack)
    gauge = (Bpc303Sensor if rack else Kpc101Sensor).from_settings(rig.settings(timeout_s=1.0))
    gauge.open()
    rig.fault(delay_s=1.5)
    with pytest.raises(DeviceTimeout):
        gauge.read()
    rig.server.call(lambda: rig.outputs_v[1].append(50.0))
    rig.fault()
    for _ in range(20):
        try:
            found_um = gauge.read()
            break
        except DeviceTimeout:
            continue
    assert found_um == pytest.approx(5.0, abs=2e-3)
    gauge.close()


def test_a_late_position_of_one_bay_is_not_taken_for_anothers(make: Make) -> None:
    rig = make(rack=True)
    one, two = (Bpc303Sensor.from_settings(rig.settings(channel=n, timeout_s=2.0)) for n in (1, 2))
    for gauge in (one, two):
        gauge.open()
    rig.server.call(lambda: rig.outputs_v[1].append(10.0))
    rig.server.call(lambda: rig.outputs_v[2].append(20.0))
    rig.fault(delay_s=2.2)
    with pytest.raises(DeviceTimeout):
        one.read()
    rig.fault()
    assert two.read() == pytest.approx(2.0, abs=2e-3)  # the late reply of bay 1 arrives first
    one.close()
    two.close()


@pytest.mark.parametrize("rack", [False, True])
@pytest.mark.parametrize("connected", [False, True])
def test_set_up_recognises_the_unit_and_its_gauge(make: Make, rack: bool, connected: bool) -> None:
    rig = make(rack=rack, gauge=connected)
    unit = ask_port(rig.server.port, "x")
    assert unit is not None
    name = "bpc303" if rack else "kpc101"
    assert (unit.kind, unit.driver) == ("actuator", name)
    assert unit.serial == ("71000123" if rack else "113000123")
    gauge = gauge_beside(unit)
    assert (gauge is not None) is connected
    if gauge is not None:
        assert (gauge.kind, gauge.driver, gauge.settings) == ("sensor", name, unit.settings)


@pytest.mark.parametrize("channel", [0, 4])
def test_a_channel_that_no_unit_has(channel: int) -> None:
    with pytest.raises(DriverConfigError, match="channel"):
        Bpc303.from_settings({"channel": channel})
