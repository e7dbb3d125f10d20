"""The KPZ101 driver, with its emulator on a pty."""

import shutil
import tempfile
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import ClassVar

import pytest

from dehyst.drivers.apt.codec import encode_apt
from dehyst.drivers.contract import ActuatorContract
from dehyst.drivers.emulated.kpz101_knobs import Kpz101Faults, Kpz101Knobs
from dehyst.drivers.emulated.kpz101_unit import Kpz101Unit
from dehyst.drivers.emulated.ksg101_unit import Ksg101Unit
from dehyst.drivers.emulated.pty_device import PtyServer
from dehyst.drivers.interface import (
    DeviceTimeout,
    DriverConfigError,
    DriverError,
    ForeignUnit,
    OutOfRange,
    ProtocolError,
    UnitIdentity,
)
from dehyst.drivers.kpz101 import Kpz101
from dehyst.drivers.ksg101 import Ksg101


class Rig:
    """An emulator, its pty, and every voltage that its output has had."""

    def __init__(self, folder: Path, **knobs: object) -> None:
        self.outputs_v: list[float] = []
        self.unit = Kpz101Unit(
            Kpz101Knobs(**knobs),  # type: ignore[arg-type]
            lambda volts, time_s: self.outputs_v.append(volts),
        )
        self.server = PtyServer(self.unit, folder / "kpz101")
        self.server.start()

    def driver(self, **settings: object) -> Kpz101:
        return Kpz101.from_settings({"port": self.server.port, "timeout_s": 1.0, **settings})

    def fault(self, **faults: object) -> None:
        self.server.call(lambda: setattr(self.unit, "faults", Kpz101Faults(**faults)))  # type: ignore[arg-type]


@contextmanager
def impatient(device: Kpz101, match: str | None = None) -> Iterator[None]:
    """Expect a time-out, without the long one for a busy machine."""
    link = device._channel._link
    link.timeout_s, patience_s = 0.15, link.timeout_s
    with pytest.raises(DeviceTimeout, match=match):
        yield
    link.timeout_s = patience_s


Make = Callable[..., Rig]


@pytest.fixture
def rigs(tmp_path: Path) -> Iterator[list[Rig]]:
    made: list[Rig] = []
    yield made
    for rig in made:
        rig.server.stop()


@pytest.fixture
def make(rigs: list[Rig], tmp_path: Path) -> Make:
    def made(**knobs: object) -> Rig:
        rigs.append(Rig(tmp_path, **knobs))
        return rigs[-1]

    return made


class TestKpz101Contract(ActuatorContract):
    knobs: ClassVar[dict[str, object]] = {}
    settings: ClassVar[dict[str, object]] = {}

    def setup_method(self) -> None:
        self.folder = Path(tempfile.mkdtemp())
        self.rig = Rig(self.folder, **self.knobs)

    def teardown_method(self) -> None:
        self.rig.server.stop()
        shutil.rmtree(self.folder)

    def make(self) -> Kpz101:
        return self.rig.driver(**self.settings)

    def true_output(self, device: Kpz101) -> float:
        return self.rig.server.call(lambda: self.rig.unit.output_v())

    def unplug(self, device: Kpz101) -> None:
        self.rig.server.unplug()

    def replug(self, device: Kpz101) -> None:
        self.rig.server.plug()


class TestKpz101OfLess(TestKpz101Contract):
    """A unit limited to 75 V, not at 0 V, with a limit of ours that lies between two counts."""

    knobs: ClassVar = {"limit_v": 75, "start_v": 20.0, "enabled": True, "chunk_size": 3}
    settings: ClassVar = {"limit_v": 75, "max_v": 60.0001}


def test_learns_the_unit(make: Make) -> None:
    rig = make(limit_v=100)
    device = rig.driver()
    device.open()
    assert device.spec.identity == "KPZ101 serial 29000123 firmware 1.0.3 limit 100 V"
    assert (device.spec.minimum, device.spec.maximum) == (0.0, 100.0)
    assert device.unit is not None
    assert device.unit.serial == "29000123"
    assert device.spec.resolution == pytest.approx(100 / 32767)
    device.close()


def test_the_emulated_unit_takes_one_message_after_the_other() -> None:
    """In virtual time each message takes 2 ms, and a write is two messages."""
    unit = Kpz101Unit(Kpz101Knobs(latency_s=2e-3), clock=lambda: now_s)
    now_s, messages = 0.0, []
    first = encode_apt("pz_set_outputvolts", chan=1, voltage=0)
    unit.feed(first + encode_apt("pz_req_outputvolts", chan=1))
    while not messages:
        due_s = unit.next_due_s()
        assert due_s is not None
        now_s = due_s
        messages = [data for data in (unit.take(),) if data]
    assert now_s == pytest.approx(4e-3)


@pytest.mark.processes
def test_the_declared_rate_is_that_of_sets_not_of_requests(make: Make) -> None:
    rig = make(latency_s=4e-3)
    device = rig.driver()
    device.open()
    assert device.spec.latency_s >= 2 * 4e-3  # includes both messages
    assert device.spec.max_rate_hz <= 1.0 / (2 * 4e-3)
    assert (rig.unit.sets_done > 0, rig.outputs_v) == (True, [])
    device.close()


@pytest.mark.parametrize("limit_v", [75, 100, 150])
def test_the_same_voltage_at_every_limit(make: Make, limit_v: int) -> None:
    rig = make(limit_v=limit_v)
    device = rig.driver(max_v=70.0)
    device.open()
    for volts in (0.0, 12.345, 70.0):
        device.write(volts)
        assert rig.unit.output_v() == pytest.approx(volts, abs=device.spec.resolution)
        assert rig.unit.output_v() <= 70.0
    device.close()


@pytest.mark.parametrize("stored_v", [0.0, 40.0, 150.0])
def test_a_disabled_output_is_enabled_without_a_jump(make: Make, stored_v: float) -> None:
    rig = make(start_v=stored_v)
    device = rig.driver()
    device.open()
    assert device.output() == 0.0
    device.write(3.0)
    assert rig.outputs_v == [pytest.approx(3.0, abs=device.spec.resolution)]
    device.close()


def test_a_disabled_output_that_keeps_its_voltage_stays_disabled(make: Make) -> None:
    rig = make(start_v=40.0)
    rig.fault(stuck=True)
    with pytest.raises(ProtocolError, match="would jump"):
        rig.driver().open()
    assert rig.outputs_v == []


@pytest.mark.parametrize(
    ("knobs", "settings", "says"),
    [
        *(({"mode": mode}, {}, f"mode {mode}; set it to open loop") for mode in (2, 3, 4)),
        ({"source": 1}, {}, "external signal"),
        ({"source": 2}, {}, "potentiometer"),
        ({"source": 3}, {}, "external signal and the potentiometer"),
        ({"limit_v": 75}, {"max_v": 75.5}, "max_v is 75.5 V, above .* 75 V"),
        ({"limit_v": 150}, {"limit_v": 75}, "limit is 150 V, but limit_v is 75 V"),
        ({"limit_v": 75}, {"limit_v": 100}, "limit is 75 V, but limit_v is 100 V"),
        ({"start_v": 80.0}, {"max_v": 75.0}, "output is at 80"),
    ],
)
@pytest.mark.parametrize("enabled", [True, False])
def test_a_unit_that_cannot_be_used_as_it_stands_is_not_touched(
    make: Make,
    knobs: dict,
    settings: dict,
    says: str,
    enabled: bool,
) -> None:
    if says.startswith("output is") and not enabled:
        enabled = True  # a disabled output is at 0 V, which is in range
    rig = make(enabled=enabled, **knobs)
    with pytest.raises(DriverConfigError, match=says):
        rig.driver(**settings).open()
    assert (rig.outputs_v, rig.unit.sets_done) == ([], 0)


def test_nothing_is_sent_for_a_voltage_beyond_the_range(make: Make) -> None:
    rig = make()
    device = rig.driver(max_v=75.0)
    device.open()
    before = rig.unit.sets_done
    for volts in (75.0001, -0.0001, 150.0, float("nan")):
        with pytest.raises(OutOfRange):
            device.write(volts)
    assert rig.unit.sets_done == before
    device.close()


def test_another_kind_of_unit_is_refused_both_ways(tmp_path: Path, make: Make) -> None:
    rig = make()
    with pytest.raises(ForeignUnit, match="'KPZ101', but the configuration asks for a KSG101"):
        Ksg101.from_settings({"port": rig.server.port, "timeout_s": 1.0}).open()
    with (
        PtyServer(Ksg101Unit(), tmp_path / "gauge") as gauge,
        pytest.raises(ForeignUnit, match="'KSG101', but the configuration asks for a KPZ101"),
    ):
        Kpz101.from_settings({"port": gauge.port, "timeout_s": 1.0}).open()


def test_a_foreign_unit_gets_no_voltage(make: Make) -> None:
    rig = make()
    known = rig.driver()
    known.expect(UnitIdentity("29000124"))
    with pytest.raises(ForeignUnit, match="29000123"):
        known.open()
    with pytest.raises(ForeignUnit, match="29000123"):
        rig.driver(serial_number="29000124").open()
    device = rig.driver()
    device.open()
    device.write(20.0)
    other = Kpz101Unit(Kpz101Knobs(serial_number=29999999, start_v=50.0, enabled=True))
    rig.server.call(lambda: setattr(rig.server, "unit", other))
    with pytest.raises(ForeignUnit, match=r"29999999.* 29000123"):
        device.reconnect()
    with pytest.raises(DriverError):
        device.write(21.0)
    assert (other.output_v(), other.sets_done) == (pytest.approx(50.0, abs=0.01), 0)


def test_a_unit_that_lost_power_starts_from_zero(make: Make) -> None:
    rig = make()
    device = rig.driver()
    device.open()
    device.write(90.0)
    rig.server.unplug()
    with pytest.raises(DriverError):
        device.write(91.0)
    fresh = Kpz101Unit(Kpz101Knobs(start_v=0.0))
    rig.server.call(lambda: setattr(rig.server, "unit", fresh))
    rig.server.plug()
    device.reconnect()
    assert (device.output(), fresh.output_v()) == (0.0, 0.0)
    device.close()


def test_a_set_that_is_not_carried_out_is_noticed(make: Make) -> None:
    rig = make()
    device = rig.driver()
    device.open()
    device.write(10.0)
    rig.fault(stuck=True)
    with pytest.raises(ProtocolError, match=r"set to 20\.\d* V but reports"):
        device.write(20.0)
    assert device.output() == pytest.approx(10.0, abs=device.spec.resolution)
    device.close()


def test_a_unit_that_was_put_into_closed_loop_is_noticed(make: Make) -> None:
    rig = make()
    device = rig.driver()
    device.open()
    rig.server.call(lambda: setattr(rig.unit, "_mode", 2))
    with pytest.raises(ProtocolError, match="open loop"):
        device.write(20.0)
    device.close()


@pytest.mark.parametrize("size", [1, 2, 5])
def test_replies_in_pieces_and_after_garbage(make: Make, size: int) -> None:
    rig = make(chunk_size=size)
    device = rig.driver()
    device.open()
    rig.fault(garbage=10)
    for n in range(10):
        device.write(float(n))
        assert rig.unit.output_v() == pytest.approx(float(n), abs=device.spec.resolution)
    device.close()


def test_a_late_reply_is_not_taken_for_the_next_one(make: Make) -> None:
    rig = make()
    device = rig.driver(timeout_s=2.0)
    device.open()
    device.write(1.0)
    rig.fault(delay_s=1.0)
    with impatient(device, match="pz_req_outputvolts within"):
        device.write(2.0)
    assert device.output() == pytest.approx(1.0, abs=device.spec.resolution)
    rig.fault()
    for _ in range(20):  # until the replies after the late one have arrived
        try:
            device.write(9.0)
            break
        except DeviceTimeout:
            continue
    else:
        pytest.fail("never recovered")
    assert device.output() == pytest.approx(9.0, abs=device.spec.resolution)
    device.close()


def test_after_a_lost_reply_reconnect_asks_where_the_output_stands(make: Make) -> None:
    rig = make()
    device = rig.driver(timeout_s=2.0)
    device.open()
    device.write(1.0)
    rig.fault(mute=True)  # the set is carried out, its reply is lost
    with impatient(device):
        device.write(2.0)
    rig.fault()
    device.reconnect()
    assert device.output() == pytest.approx(rig.unit.output_v(), abs=1e-9)
    assert rig.unit.output_v() == pytest.approx(2.0, abs=device.spec.resolution)
    device.close()


@pytest.mark.parametrize(
    ("settings", "says"),
    [
        ({"prot": "x"}, "prot.*known.*port"),
        ({"limit_v": 120}, "limit_v"),
        ({"max_v": 0}, "max_v"),
        ({"max_v": 151}, "max_v"),
        ({"limit_v": 75, "max_v": 100}, "max_v.*at most limit_v"),
        ({"timeout_s": 0}, "timeout_s"),
    ],
)
def test_wrong_settings_are_named(settings: dict, says: str) -> None:
    with pytest.raises(DriverConfigError, match=says):
        Kpz101.from_settings(settings)
