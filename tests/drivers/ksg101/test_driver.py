"""The KSG101 driver, with its emulator on a pty."""

import math
import shutil
import tempfile
import threading
from collections.abc import Iterator
from pathlib import Path

import pytest

from dehyst.drivers.contract import SensorContract
from dehyst.drivers.emulated.ksg101_knobs import Ksg101Faults, Ksg101Knobs
from dehyst.drivers.emulated.ksg101_unit import Ksg101Unit
from dehyst.drivers.emulated.pty_device import PtyServer
from dehyst.drivers.interface import (
    DeviceNotFound,
    DeviceTimeout,
    DriverConfigError,
)
from dehyst.drivers.ksg101 import Ksg101

COUNT_UM = 20.0 / 32767


class Rig:
    """An emulator, its pty and the displacement that it shows."""

    def __init__(self, folder: Path, **knobs: object) -> None:
        self.position_um = 5.0
        self.unit = Ksg101Unit(Ksg101Knobs(**knobs), lambda time_s: self.position_um)  # type: ignore[arg-type]
        self.server = PtyServer(self.unit, folder / "ksg101")
        self.server.start()

    def driver(self, **settings: object) -> Ksg101:
        return Ksg101.from_settings({"port": self.server.port, "timeout_s": 1.0, **settings})


@pytest.fixture
def rig(tmp_path: Path) -> Iterator[Rig]:
    made = Rig(tmp_path)
    yield made
    made.server.stop()


class TestKsg101Contract(SensorContract):
    tolerance = COUNT_UM

    def setup_method(self) -> None:
        self.folder = Path(tempfile.mkdtemp())
        self.rig = Rig(self.folder)

    def teardown_method(self) -> None:
        self.rig.server.stop()
        shutil.rmtree(self.folder)

    def make(self) -> Ksg101:
        return self.rig.driver()

    def true_value(self, device: Ksg101) -> float:
        return self.rig.position_um

    def unplug(self, device: Ksg101) -> None:
        self.rig.server.unplug()

    def replug(self, device: Ksg101) -> None:
        self.rig.server.plug()


def test_learns_the_unit(rig: Rig) -> None:
    sensor = rig.driver()
    sensor.open()
    assert sensor.spec.identity == "KSG101 serial 59000123 firmware 1.0.3"
    assert (sensor.spec.minimum, sensor.spec.maximum) == (-20.0, 20.0)
    assert 0 < sensor.spec.latency_s < 1
    for position in (0.0, -7.25, 19.9):
        rig.position_um = position
        assert sensor.read() == pytest.approx(position, abs=COUNT_UM)
    sensor.close()


@pytest.mark.parametrize("position", [25.0, -25.0, math.nan])
def test_full_scale_is_no_reading(rig: Rig, position: float) -> None:
    sensor = rig.driver()
    sensor.open()
    rig.position_um = position
    assert math.isnan(sensor.read())
    sensor.close()


def test_calibration_and_travel_settings(tmp_path: Path) -> None:
    rig = Rig(tmp_path, scale_error=1.25)
    sensor = rig.driver(calibration=0.8)
    sensor.open()
    assert sensor.read() == pytest.approx(5.0, abs=COUNT_UM)
    sensor.close()
    sensor = rig.driver(max_travel_um=40.0)
    sensor.open()
    assert sensor.read() == pytest.approx(5.0 * 1.25 * 2, abs=4 * COUNT_UM)
    sensor.close()
    rig.server.stop()


def test_unit_without_a_travel_is_asked_of_the_user(tmp_path: Path) -> None:
    rig = Rig(tmp_path, max_travel_um=0.01)
    with pytest.raises(DriverConfigError, match="set max_travel_um"):
        rig.driver().open()
    rig.server.stop()


def test_smoothed_reading_below_zero(rig: Rig) -> None:
    rig.position_um = -3.0
    sensor = rig.driver(smoothed=True)
    sensor.open()
    assert sensor.read() == pytest.approx(-3.0, abs=COUNT_UM)
    sensor.close()


def test_zero_is_the_present_position(rig: Rig) -> None:
    sensor = rig.driver()
    sensor.open()
    sensor.zero()
    rig_before = sensor.read()
    rig.position_um += 2.0
    assert rig_before == pytest.approx(0.0, abs=COUNT_UM)
    assert sensor.read() == pytest.approx(2.0, abs=COUNT_UM)
    sensor.close()


@pytest.mark.parametrize("size", [1, 2, 5])
def test_replies_in_pieces_and_behind_garbage(tmp_path: Path, size: int) -> None:
    rig = Rig(tmp_path, chunk_size=size)
    sensor = rig.driver()
    sensor.open()
    rig.unit.faults = Ksg101Faults(garbage=10)
    for n in range(10):
        rig.position_um = float(n)
        assert sensor.read() == pytest.approx(float(n), abs=COUNT_UM)
    sensor.close()
    rig.server.stop()


def test_a_late_reply_is_not_taken_for_the_next_one(rig: Rig) -> None:
    sensor = rig.driver(timeout_s=2.0)
    sensor.open()
    rig.position_um = 1.0
    rig.server.call(lambda: setattr(rig.unit, "faults", Ksg101Faults(delay_s=1.0)))
    link = sensor._require_link()
    link.timeout_s, patience_s = 0.15, link.timeout_s
    with pytest.raises(DeviceTimeout, match="tsg_req_reading within"):
        sensor.read()
    link.timeout_s = patience_s
    rig.server.call(lambda: setattr(rig.unit, "faults", Ksg101Faults()))
    rig.position_um = 9.0
    for _ in range(20):  # until the queue after the late reply has moved on
        try:
            assert sensor.read() == pytest.approx(9.0, abs=COUNT_UM)
            break
        except DeviceTimeout:
            continue
    else:
        pytest.fail("never recovered")
    assert sensor.read() == pytest.approx(9.0, abs=COUNT_UM)
    sensor.close()


def test_a_mute_unit_times_out_at_open(rig: Rig) -> None:
    rig.unit.faults = Ksg101Faults(mute=True)
    with pytest.raises(DeviceTimeout, match="hw_req_info"):
        rig.driver(timeout_s=0.05).open()


def test_another_unit_behind_the_port_is_noticed(rig: Rig) -> None:
    sensor = rig.driver()
    sensor.open()
    other = Ksg101Unit(Ksg101Knobs(serial_number=59999999))
    rig.server.call(lambda: setattr(rig.server, "unit", other))
    with pytest.raises(DeviceNotFound, match=r"59999999; .* 59000123"):
        sensor.reconnect()


@pytest.mark.parametrize(
    ("settings", "says"),
    [
        ({"prot": "x"}, "prot.*known.*port"),
        ({"port": 3}, "port"),
        ({"calibration": 0.0}, "calibration"),
        ({"smoothed": 1}, "smoothed"),
        ({"timeout_s": 0}, "timeout_s"),
        ({"max_travel_um": -1}, "max_travel_um"),
        ({"timeout_s": True}, "timeout_s"),
    ],
)
def test_wrong_settings_are_named(settings: dict, says: str) -> None:
    with pytest.raises(DriverConfigError, match=says):
        Ksg101.from_settings(settings)


def test_no_threads_are_left_behind() -> None:
    assert not [t for t in threading.enumerate() if t.name.startswith("pty ")]
