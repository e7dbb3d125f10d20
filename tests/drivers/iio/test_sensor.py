"""The IIO sensor driver, on real files laid out like sysfs."""

import math
import shutil
import tempfile
from pathlib import Path

import pytest
from tests.rigs.sysfs import lay_out, put_back, take_away

from dehyst.drivers.contract import SensorContract
from dehyst.drivers.iio import IioSensor
from dehyst.drivers.interface import DeviceGone, DeviceNotFound, DriverConfigError, ProtocolError


def device(folder: Path, **files: str) -> Path:
    """Return an AD7124 as the kernel shows it."""
    content = {"name": "ad7124-4", "in_voltage0_raw": "100000", "in_voltage0_scale": "0.0001"}
    return lay_out(folder, {**content, **files})


class TestIioContract(SensorContract):
    tolerance = 1e-9

    def setup_method(self) -> None:
        self.base = Path(tempfile.mkdtemp())
        self.folder = device(self.base / "iio:device0")

    def teardown_method(self) -> None:
        shutil.rmtree(self.base)

    def make(self) -> IioSensor:
        return IioSensor.from_settings({"path": str(self.folder), "um_per_mv": 0.5})

    def true_value(self, device: IioSensor) -> float:
        return 100000 * 0.0001 * 0.5

    def unplug(self, device: IioSensor) -> None:
        take_away(self.folder)

    def replug(self, device: IioSensor) -> None:
        put_back(self.folder)


def opened(folder: Path, **settings: object) -> IioSensor:
    sensor = IioSensor.from_settings({"path": str(folder), **settings})
    sensor.open()
    return sensor


def test_scale_offset_and_zero(tmp_path: Path) -> None:
    device(tmp_path / "d", in_voltage0_offset="-8388608", in_voltage0_raw="8400000")
    sensor = opened(tmp_path / "d", unsigned=True, zero_mv=0.1, um_per_mv=2.0)
    assert sensor.read() == pytest.approx(((8400000 - 8388608) * 0.0001 - 0.1) * 2.0)
    (tmp_path / "d" / "in_voltage0_raw").write_text("8388608\n")
    assert sensor.read() == pytest.approx(-0.2)
    assert sensor.spec.identity == "IIO ad7124-4 voltage0"


def test_differential_channel_with_shared_scale(tmp_path: Path) -> None:
    files = {"in_voltage1-voltage2_raw": "-500", "in_voltage-voltage_scale": "0.01"}
    folder = device(tmp_path / "d", **files)
    assert opened(folder, channel="voltage1-voltage2").read() == pytest.approx(-5.0)


@pytest.mark.parametrize("counts", [2**23 - 1, -(2**23)])
def test_converter_at_its_end_is_nan(tmp_path: Path, counts: int) -> None:
    folder = device(tmp_path / "d", in_voltage0_raw=str(counts))
    assert math.isnan(opened(folder).read())


def test_errors_say_what_is_there(tmp_path: Path) -> None:
    with pytest.raises(DeviceNotFound, match="no device"):
        opened(tmp_path / "nothing")
    folder = device(tmp_path / "d")
    with pytest.raises(DeviceNotFound, match="channels here: voltage0"):
        opened(folder, channel="voltage7")
    sensor = opened(folder)
    (folder / "in_voltage0_raw").write_text("busy\n")
    with pytest.raises(ProtocolError, match="busy"):
        sensor.read()
    (folder / "in_voltage0_raw").write_text("")
    with pytest.raises(DeviceGone, match="empty"):
        sensor.read()


@pytest.mark.parametrize(
    ("settings", "says"),
    [
        ({"um_per_mv": 0.0}, "um_per_mv"),
        ({"um_per_mv": True}, "um_per_mv"),
        ({"bits": 24.5}, "bits"),
        ({"bits": 64}, "bits"),
        ({"channel": "../x"}, "channel"),
        ({"path": 3}, "path"),
    ],
)
def test_wrong_settings_are_named(settings: dict, says: str) -> None:
    with pytest.raises(DriverConfigError, match=says):
        IioSensor.from_settings(settings)
