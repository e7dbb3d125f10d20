"""The emulated bench with a KPC101, and with two channels of a BPC303, as `dehyst emulate` starts
it: the units have their own gauges."""

import math
from collections.abc import Iterator

import pytest
from tests.rigs.processes import emulated_bench, until

from dehyst.daemon.main import main
from dehyst.daemon.setup.units import units_at
from dehyst.drivers.emulated.control import ask
from dehyst.drivers.interface import DeviceGone, DeviceTimeout, DriverConfigError, ProtocolError
from dehyst.drivers.kpc101 import Bpc303, Bpc303Sensor, Kpc101, Kpc101Sensor

PATIENCE_S = 30.0


@pytest.fixture(scope="module")
def one(tmp_path_factory: pytest.TempPathFactory) -> Iterator[dict[str, str]]:
    words = ("--amplifier", "kpc101", "--limit-v", "75", "--start-v", "20")
    with emulated_bench(tmp_path_factory.mktemp("one"), *words) as ports:
        yield ports


@pytest.fixture(scope="module")
def rack(tmp_path_factory: pytest.TempPathFactory) -> Iterator[dict[str, str]]:
    words = ("--amplifier", "bpc303", "--axes", "2")
    with emulated_bench(tmp_path_factory.mktemp("rack"), *words) as ports:
        yield ports


Pair = tuple[Kpc101, Kpc101Sensor]


@pytest.fixture
def pair(one: dict[str, str]) -> Iterator[Pair]:
    ask(one["control"], {"clear": True})
    settings = {"port": one["kpc101"], "timeout_s": 1.0}
    devices = Kpc101.from_settings(settings), Kpc101Sensor.from_settings(settings)
    for device in devices:
        device.open()
    yield devices
    for device in devices:
        device.close()


def test_the_amplifier_has_no_gauge_reader_beside_it(one: dict[str, str]) -> None:
    assert set(one) == {"kpc101", "control"}


def test_volts_in_micrometres_out_at_one_port(one: dict[str, str], pair: Pair) -> None:
    amplifier, gauge = pair
    assert (amplifier.spec.maximum, gauge.spec.unit) == (75.0, "um")
    amplifier.write(0.0)
    until(lambda: ask(one["control"], {})["drive_v"] < 0.01)
    low_um = gauge.read()
    amplifier.write(75.0)
    until(lambda: ask(one["control"], {})["drive_v"] > 74.99)
    assert gauge.read() > low_um + 3.0
    state = ask(one["control"], {})
    assert (state["output_v"], state["plugged"]) == (75.0, {"kpc101": True})
    assert state["readings"] > 0


def test_faults_of_the_unit_are_those_of_both_roles(one: dict[str, str], pair: Pair) -> None:
    amplifier, gauge = pair
    amplifier.write(30.0)
    ask(one["control"], {"gauge": {"mute": True}})
    with pytest.raises(DeviceTimeout):
        gauge.read()
    ask(one["control"], {"clear": True, "amplifier": {"stuck": True}})
    with pytest.raises(ProtocolError):
        amplifier.write(31.0)
    ask(one["control"], {"clear": True, "amplifier": {"garbage": 3}})
    assert math.isfinite(gauge.read())
    ask(one["control"], {"clear": True, "gauge": {"gauge_pulled": True}})
    assert math.isnan(gauge.read())
    ask(one["control"], {"clear": True, "fault": "nan"})
    assert math.isnan(gauge.read())
    ask(one["control"], {"clear": True})
    assert math.isfinite(gauge.read())


def test_an_unplug_takes_both_roles(one: dict[str, str], pair: Pair) -> None:
    amplifier, gauge = pair
    amplifier.write(30.0)
    assert ask(one["control"], {"fault": "unplug"})["plugged"] == {"kpc101": False}
    with pytest.raises(DeviceGone):
        gauge.read()
    with pytest.raises(DeviceGone):
        amplifier.write(31.0)
    ask(one["control"], {"clear": True})
    for device in (amplifier, gauge):
        device.reconnect()
    assert amplifier.output() == pytest.approx(30.0, abs=amplifier.spec.resolution)
    assert math.isfinite(gauge.read())


@pytest.mark.parametrize(
    ("order", "says"),
    [
        ({"inputs": {"ext_v": 1.0}}, "KPC101 has no"),
        ({"fault": "unplug", "device": "ksg101"}, "kpc101 or both"),
        ({"gauge": {"hang": True}}, "unknown setting 'hang'"),
    ],
)
def test_orders_for_another_bench_are_refused(
    one: dict[str, str], order: dict[str, object], says: str
) -> None:
    with pytest.raises(DriverConfigError, match=says):
        ask(one["control"], order)


def test_set_up_recognises_the_unit_and_its_gauge(one: dict[str, str]) -> None:
    ask(one["control"], {"clear": True})
    found = units_at(one["kpc101"], "x", (("actuator", "kpc101"),))
    assert [(unit.kind, unit.serial) for unit in found] == [
        ("actuator", "113000123"),
        ("sensor", "113000123"),
    ]


def test_each_channel_of_a_rack_moves_its_own_axis(rack: dict[str, str]) -> None:
    assert set(rack) == {"bpc303", "control"}
    settings = {"port": rack["bpc303"], "timeout_s": 1.0}
    outputs = [Bpc303.from_settings({**settings, "channel": n}) for n in (1, 2)]
    gauges = [Bpc303Sensor.from_settings({**settings, "channel": n}) for n in (1, 2)]
    for device in (*outputs, *gauges):
        device.open()
    before_um = [gauge.read() for gauge in gauges]
    outputs[1].write(100.0)
    until(lambda: ask(rack["control"], {"axis": "y"})["drive_v"] > 99.99)
    moved_um = [gauge.read() - um for gauge, um in zip(gauges, before_um, strict=True)]
    assert moved_um[1] > 5.0
    assert abs(moved_um[0]) < 0.1 * moved_um[1]  # cross coupling
    state = ask(rack["control"], {})["axes"]
    assert (state["x"]["output_v"], state["y"]["output_v"]) == (0.0, pytest.approx(100.0, abs=5e-3))
    for device in (*outputs, *gauges):
        device.close()


def test_a_channel_that_drives_no_axis_has_no_gauge(rack: dict[str, str]) -> None:
    gauge = Bpc303Sensor.from_settings({"port": rack["bpc303"], "channel": 3, "timeout_s": 1.0})
    with pytest.raises(DriverConfigError, match="no strain gauge is connected to channel 3"):
        gauge.open()


@pytest.mark.parametrize(
    ("words", "says"),
    [
        (["kpc101", "--axes", "2"], "--axes: not for a KPC101"),
        (["bpc303", "--dialect", "1.05"], "--dialect: not for a BPC303"),
    ],
)
def test_what_they_do_not_have_is_refused(
    words: list[str], says: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["emulate", "--amplifier", *words]) == 2
    assert says in capsys.readouterr().err
