"""The MDT693B driver fulfils the contract of every actuator, on each firmware's emulator."""

from pathlib import Path
from typing import ClassVar, Literal

import pytest

from dehyst.drivers.contract import ActuatorContract
from dehyst.drivers.emulated.mdt693b_knobs import Mdt693bKnobs
from dehyst.drivers.emulated.mdt693b_port import Mdt693bEmulator
from dehyst.drivers.interface import DriverConfigError, ForeignUnit
from dehyst.drivers.mdt693b import Mdt693b, Mdt694b
from dehyst.drivers.mdt693b.settings import Mdt693bConfig


class _Mdt693bContract(ActuatorContract):
    dialect = "1.10"
    axes: Literal["xyz", "x"] = "xyz"
    kind: ClassVar[type[Mdt693b]] = Mdt693b

    @pytest.fixture(autouse=True)
    def _emulator(self, tmp_path: Path):
        knobs = Mdt693bKnobs(
            dialect=self.dialect, axes=self.axes, latency_s=0.0, jitter_s=0.0, start_v=20.0,
            readback_lag_s=0.0,
        )  # fmt: skip
        with Mdt693bEmulator(tmp_path / "port", knobs) as self.emulator:
            yield

    def make(self) -> Mdt693b:
        config = self.kind.settings_type(port=self.emulator.port, idle_s=0.02, timeout_s=1.0)
        return self.kind(config, sleep=lambda seconds: None)  # the readback has no lag

    def true_output(self, device: Mdt693b) -> float:
        return self.emulator.output_v("x")

    def unplug(self, device: Mdt693b) -> None:
        self.emulator.unplug()

    def replug(self, device: Mdt693b) -> None:
        self.emulator.plug()


class TestLegacy(_Mdt693bContract):
    dialect = "1.05"


class TestModern(_Mdt693bContract):
    dialect = "1.10"


class TestMdt694b(_Mdt693bContract):
    axes = "x"
    kind = Mdt694b

    def test_it_is_named_and_has_the_axis_x_alone(self) -> None:
        with self.opened() as device:
            assert device.spec.identity.startswith("MDT694B firmware 1.10")
        other = Mdt693b(Mdt693bConfig(port=self.emulator.port, axis="y", timeout_s=1.0))
        with pytest.raises(DriverConfigError, match="no axis 'y'; an MDT694B has only x"):
            other.open()
        assert self.emulator.unit.sets_done == 0

    def test_an_mdt693b_is_not_driven_as_one(self, tmp_path: Path) -> None:
        knobs = Mdt693bKnobs(latency_s=0.0, jitter_s=0.0, start_v=20.0)
        with Mdt693bEmulator(tmp_path / "other", knobs) as other:
            device = Mdt694b.from_settings({"port": other.port, "timeout_s": 1.0})
            with pytest.raises(ForeignUnit, match=r"MDT693B .*asks for an MDT694B; .*mdt693b"):
                device.open()
            assert other.unit.sets_done == 0

    def test_the_driver_of_the_other_drives_it_too(self) -> None:
        device = Mdt693b.from_settings({"port": self.emulator.port, "timeout_s": 1.0})
        device.open()
        device.write(21.0)
        assert self.emulator.output_v("x") == pytest.approx(21.0, abs=3e-3)
        device.close()

    def test_it_has_no_setting_for_the_axis(self) -> None:
        with pytest.raises(DriverConfigError, match="mdt694b: unknown setting 'axis'"):
            Mdt694b.from_settings({"port": self.emulator.port, "axis": "x"})
