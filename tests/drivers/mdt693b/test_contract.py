"""The MDT693B driver against the contract of every actuator, on each firmware's emulator."""

from pathlib import Path
from typing import Literal

import pytest

from dehyst.drivers.contract import ActuatorContract
from dehyst.drivers.emulated.mdt693b_knobs import Mdt693bKnobs
from dehyst.drivers.emulated.mdt693b_port import Mdt693bEmulator
from dehyst.drivers.interface import DriverConfigError
from dehyst.drivers.mdt693b import Mdt693b
from dehyst.drivers.mdt693b.settings import Mdt693bConfig


class _Mdt693bContract(ActuatorContract):
    dialect = "1.10"
    axes: Literal["xyz", "x"] = "xyz"

    @pytest.fixture(autouse=True)
    def _emulator(self, tmp_path: Path):
        knobs = Mdt693bKnobs(
            dialect=self.dialect, axes=self.axes, latency_s=0.0, jitter_s=0.0, start_v=20.0,
            readback_lag_s=0.0,
        )  # fmt: skip
        with Mdt693bEmulator(tmp_path / "port", knobs) as self.emulator:
            yield

    def make(self) -> Mdt693b:
        config = Mdt693bConfig(port=self.emulator.port, idle_s=0.02, timeout_s=1.0)
        return Mdt693b(config, sleep=lambda seconds: None)  # the readback has no lag

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


class TestSingleAxis(_Mdt693bContract):
    """An MDT694B."""

    axes = "x"

    def test_it_is_named_and_has_the_axis_x_alone(self) -> None:
        with self.opened() as device:
            assert device.spec.identity.startswith("MDT694B firmware 1.10")
        other = Mdt693b(Mdt693bConfig(port=self.emulator.port, axis="y", timeout_s=1.0))
        with pytest.raises(DriverConfigError, match="no axis 'y'; an MDT694B has x alone"):
            other.open()
        assert self.emulator.unit.sets_done == 0
