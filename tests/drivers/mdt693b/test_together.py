"""Several outputs of one MDT693B through one port: real pyserial, the emulated unit."""

import threading
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest

from dehyst.drivers.contract import ActuatorContract
from dehyst.drivers.emulated.mdt693b_knobs import Mdt693bKnobs
from dehyst.drivers.emulated.mdt693b_port import Mdt693bEmulator
from dehyst.drivers.interface import (
    Actuator,
    DeviceGone,
    DeviceNotFound,
    DeviceTimeout,
    DriverConfigError,
    DriverError,
    Joinable,
    OutOfRange,
    ProtocolError,
)
from dehyst.drivers.mdt693b import Mdt693b

FAST = {"latency_s": 0.0, "jitter_s": 0.0, "readback_lag_s": 0.0, "start_v": 20.0}


def output(emulator: Mdt693bEmulator, axis: str, **settings: object) -> Mdt693b:
    table = {"port": emulator.port, "axis": axis, "idle_s": 0.02, "timeout_s": 0.5}
    return Mdt693b.from_settings(table | settings)


@contextmanager
def bench(
    folder: Path, axes: str = "xyz", **knobs: object
) -> Iterator[tuple[Mdt693bEmulator, list[Mdt693b]]]:
    """Yield an emulated unit and an open driver for each of these outputs."""
    with Mdt693bEmulator(folder / "port", Mdt693bKnobs(**FAST | knobs)) as emulator:
        outputs = [output(emulator, axis) for axis in axes]
        try:
            for one in outputs:
                one.open()
            yield emulator, outputs
        finally:
            for one in outputs:
                one.close()


def test_each_output_is_its_own_and_none_moves_another(tmp_path: Path) -> None:
    with bench(tmp_path) as (emulator, outputs):
        for one, volts in zip(outputs, (30.0, 40.0, 50.0), strict=True):
            one.write(volts)
        assert [round(emulator.output_v(a), 1) for a in "xyz"] == [30.0, 40.0, 50.0]
        assert [one.output() for one in outputs] == [30.0, 40.0, 50.0]
        assert [round(one.readback()) for one in outputs] == [30, 40, 50]
        outputs[0].close()  # the others continue
        outputs[1].write(41.0)
        assert emulator.output_v("y") == pytest.approx(41.0, abs=2e-3)
        with pytest.raises(DeviceGone):
            outputs[0].write(31.0)
        outputs[0].open()
        outputs[0].write(32.0)
        assert emulator.output_v("x") == pytest.approx(32.0, abs=2e-3)


@pytest.mark.parametrize(("dialect", "together"), [("1.10", True), ("1.09", True), ("1.05", False)])
def test_all_three_in_one_command_where_the_firmware_can(
    tmp_path: Path, dialect: str, together: bool
) -> None:
    with bench(tmp_path, dialect=dialect) as (emulator, outputs):
        assert isinstance(outputs[0], Joinable)
        assert len({one.unit_key for one in outputs}) == 1
        z, x, y = outputs[2], outputs[0], outputs[1]
        joint = z.join([x, y])  # in the loop's own order
        assert joint.together is together
        if not together:
            return
        before, done = emulator.unit.commands_done, emulator.unit.sets_of_all
        joint.write_all([53.0, 31.0, 42.0])
        assert [round(emulator.output_v(a), 2) for a in "xyz"] == [31.0, 42.0, 53.0]
        assert (x.output(), y.output(), z.output()) == (31.0, 42.0, 53.0)
        assert emulator.unit.commands_done == before + 1
        assert emulator.unit.sets_of_all == done + 1
        with pytest.raises(OutOfRange):
            joint.write_all([53.0, 31.0, 151.0])
        assert emulator.unit.commands_done == before + 1
        emulator.unit.registers.max_v["y"] = 60.0  # somebody changes it at the unit
        with pytest.raises(ProtocolError):
            joint.write_all([10.0, 10.0, 70.0])
        assert [round(emulator.output_v(a)) for a in "xyz"] == [31, 42, 53]
        assert (x.output(), y.output(), z.output()) == (31.0, 42.0, 53.0)
        joint.write_all([10.0, 11.0, 12.0])  # replies still match commands after a refusal
        assert x.output() == 11.0


@pytest.mark.timing
def test_the_rate_is_that_of_the_outputs_that_are_driven(tmp_path: Path) -> None:
    """At 4 ms per command: one output, two in sequence, three in one command or in sequence. The
    best of three attempts counts, since a busy machine slows some down."""
    with bench(tmp_path, latency_s=0.004) as (_, outputs):
        joints = [outputs[0].join(outputs[1:]) for _ in range(3)]
        one, two, three = (max(joint.rate_hz(n) for joint in joints) for n in (1, 2, 3))
    assert one < 250.0
    assert two == pytest.approx(one / 2, rel=0.35)
    assert three == pytest.approx(one, rel=0.35)
    with bench(tmp_path, latency_s=0.004, dialect="1.06") as (_, outputs):
        joint = outputs[0].join(outputs[1:])
        assert joint.rate_hz(3) < 1.0 / (3 * 0.004)


def test_what_cannot_be_shared_is_refused(tmp_path: Path) -> None:
    with bench(tmp_path, "xy") as (emulator, outputs):
        with pytest.raises(DeviceNotFound, match="output x is in use"):
            output(emulator, "x").open()
        with pytest.raises(DriverConfigError, match="setting timeout_s"):
            output(emulator, "z", timeout_s=0.7).open()
        emulator.unit.registers.min_v["z"] = 60.0
        with pytest.raises(DriverConfigError, match="nothing to drive"):
            output(emulator, "z", max_v=50.0).open()
        emulator.unit.registers.min_v["z"] = 0.0
        outputs[0].write(25.0)
        late = output(emulator, "z")
        late.open()
        late.write(33.0)
        late.close()
        assert emulator.output_v("z") == pytest.approx(33.0, abs=2e-3)


def test_a_lost_link_is_lost_for_all_and_comes_back_for_all(tmp_path: Path) -> None:
    with bench(tmp_path) as (emulator, (x, y, z)):
        for one, volts in ((x, 30.0), (y, 40.0), (z, 50.0)):
            one.write(volts)
        emulator.unplug()
        with pytest.raises(DeviceGone):
            x.write(31.0)
        for one in (y, z):
            with pytest.raises(DeviceGone):
                one.write(45.0)
            with pytest.raises(DriverError):
                one.reconnect()
        emulator.plug()
        threads = [threading.Thread(target=one.reconnect) for one in (x, y, z)]
        for thread in threads:  # as in the loop: each device has its own
            thread.start()
        for thread in threads:
            thread.join(20.0)
        assert [round(emulator.output_v(a)) for a in "xyz"] == [30, 40, 50], "something moved"
        for one, volts in ((x, 32.0), (y, 42.0), (z, 52.0)):
            one.write(volts)
        assert [round(emulator.output_v(a)) for a in "xyz"] == [32, 42, 52]


def test_a_set_without_an_answer_stops_all_until_it_is_known_what_became_of_it(
    tmp_path: Path,
) -> None:
    with bench(tmp_path) as (emulator, (x, y, z)):
        x.write(30.0)
        emulator.fault(mute=True)
        with pytest.raises(DeviceTimeout):
            x.write(33.0)
        emulator.clear_faults()
        with pytest.raises(DeviceGone, match="was lost"):
            y.write(40.0)
        assert emulator.output_v("y") == pytest.approx(20.0, abs=2e-3)
        x.reconnect()
        assert x.output() == 33.0  # carried out, by the readback
        for one in (y, z):
            one.reconnect()
        y.write(40.0)
        assert emulator.output_v("y") == pytest.approx(40.0, abs=2e-3)


class TestContractBesideOthers(ActuatorContract):
    """One output fulfils the contract while another output of the unit is driven."""

    @pytest.fixture(autouse=True)
    def unit(self, tmp_path: Path) -> Iterator[None]:
        with bench(tmp_path, "z") as (self.emulator, (self.neighbour,)):
            yield

    def make(self) -> Actuator:
        return output(self.emulator, "x")

    def true_output(self, device: Actuator) -> float | None:
        return self.emulator.output_v("x")

    def unplug(self, device: Actuator) -> None:
        self.emulator.unplug()

    def replug(self, device: Actuator) -> None:
        self.emulator.plug()
