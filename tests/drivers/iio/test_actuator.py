"""The IIO output driver, on real files laid out like sysfs."""

import shutil
import tempfile
from pathlib import Path

import pytest
from tests.rigs.sysfs import KernelFile, lay_out

from dehyst.drivers.contract import ActuatorContract
from dehyst.drivers.iio import IioActuator
from dehyst.drivers.interface import (
    DeviceNotFound,
    DriverConfigError,
    OutOfRange,
    ProtocolError,
)

SCALE_MV = 10000 / 65535  # 16 bits over 10 V


def device(folder: Path, **files: str) -> Path:
    """Return an AD5686 as the kernel shows it, with its output at 20 V after a gain of 15."""
    content = {"name": "ad5686", "out_voltage0_raw": "8738", "out_voltage0_scale": str(SCALE_MV)}
    return lay_out(folder, {**content, **files})


def counts(folder: Path) -> int:
    return int((folder / "out_voltage0_raw").read_text().split("\n")[0])


def opened(folder: Path, **settings: object) -> IioActuator:
    actuator = IioActuator.from_settings({"path": str(folder), **settings})
    actuator.open()
    return actuator


@pytest.mark.processes
class TestIioActuatorContract(ActuatorContract):
    """The contract on a kernel file: a file on disk never refuses a write."""

    def setup_method(self) -> None:
        self.base = Path(tempfile.mkdtemp())
        self.kept = KernelFile()
        self.folder = device(self.base / "iio:device1", out_voltage0_scale="10")
        (self.folder / "out_voltage0_raw").unlink()
        (self.folder / "out_voltage0_raw").symlink_to(self.kept.path)

    def teardown_method(self) -> None:
        self.kept.end()
        shutil.rmtree(self.base)

    def make(self) -> IioActuator:
        return IioActuator.from_settings({"path": str(self.folder)})

    def true_output(self, device: IioActuator) -> float:
        return counts(self.folder) * 0.15  # 10 mV a count at a gain of 15

    def unplug(self, device: IioActuator) -> None:
        self.stood_at = (self.folder / "out_voltage0_raw").read_text()
        self.kept.end()

    def replug(self, device: IioActuator) -> None:
        self.kept = KernelFile()
        self.kept.path.write_text(self.stood_at)
        (self.folder / "out_voltage0_raw").unlink()
        (self.folder / "out_voltage0_raw").symlink_to(self.kept.path)


def test_where_it_stands_is_read_back_and_nothing_is_written(tmp_path: Path) -> None:
    folder = device(tmp_path / "d")
    before = (folder / "out_voltage0_raw").read_bytes()
    actuator = opened(folder)
    assert actuator.output() == pytest.approx(20.0, abs=0.0012)  # half a count
    assert (folder / "out_voltage0_raw").read_bytes() == before
    assert actuator.spec.resolution == pytest.approx(150.0 / 65535)
    assert actuator.spec.identity == "IIO ad5686 voltage0 at gain 15"


def test_offset_and_twos_complement(tmp_path: Path) -> None:
    folder = device(
        tmp_path / "d", out_voltage_scale="0.5", out_voltage0_offset="-100", out_voltage0_raw="100"
    )
    (folder / "out_voltage0_scale").unlink()  # now the scale of its kind applies
    actuator = opened(folder, gain=10.0, min_v=-20.0, max_v=20.0, unsigned=False)
    assert actuator.output() == 0.0
    actuator.write(-7.5)  # -750 mV, -1500 steps of 0.5 mV, 100 above
    assert counts(folder) == -1400


def test_the_ends_of_the_range_are_never_rounded_over(tmp_path: Path) -> None:
    folder = device(tmp_path / "d", out_voltage0_raw="15000")
    actuator = opened(folder, min_v=10.001, max_v=59.999)
    for volts, whole in ((10.001, 4370), (59.999, 26213)):  # 4369.4 and 26213.56 counts
        actuator.write(volts)
        assert counts(folder) == whole
    with pytest.raises(OutOfRange):
        actuator.write(60.0)


@pytest.mark.parametrize(
    ("files", "settings", "error", "says"),
    [
        ({}, {"max_v": 151.0}, DriverConfigError, "0 to 150 V"),
        ({}, {"bits": 12}, DriverConfigError, "12 bits"),
        ({}, {"max_v": 15.0}, DriverConfigError, "output is at 20"),
        ({}, {"channel": "voltage3"}, DeviceNotFound, "channels here: voltage0"),
        ({"out_voltage0_scale": "0"}, {}, DeviceNotFound, "scale"),
        ({"out_voltage0_raw": "high"}, {}, ProtocolError, "high"),
        ({}, {"min_v": 150.0}, DriverConfigError, "min_v"),
        ({}, {"gain": 0.0}, DriverConfigError, "gain"),
    ],
)
def test_what_cannot_work_is_refused_and_nothing_is_written(
    tmp_path: Path, files: dict, settings: dict, error: type, says: str
) -> None:
    folder = device(tmp_path / "d", **files)
    before = (folder / "out_voltage0_raw").read_bytes()
    with pytest.raises(error, match=says):
        opened(folder, **settings)
    assert (folder / "out_voltage0_raw").read_bytes() == before


@pytest.mark.processes
def test_what_the_kernel_refuses_is_reported_and_the_output_stays(tmp_path: Path) -> None:
    kept = KernelFile()
    try:
        folder = device(tmp_path / "d", out_voltage0_scale="1")
        (folder / "out_voltage0_raw").unlink()
        (folder / "out_voltage0_raw").symlink_to(kept.path)
        actuator = opened(folder, gain=10.0, max_v=20.0)  # 2000 counts; the kernel takes 1000
        actuator.write(9.0)
        with pytest.raises(ProtocolError, match="Invalid argument"):
            actuator.write(11.0)
        assert (actuator.output(), kept.path.read_text()) == (9.0, "900\n")
    finally:
        kept.end()
