"""The emulated bench with a KPZ101 as its amplifier, as `dehyst emulate` starts it."""

from collections.abc import Iterator

import pytest
from tests.rigs.processes import emulated_bench, until

from dehyst.daemon.main import main
from dehyst.daemon.setup.units import ask_port
from dehyst.drivers.emulated.control import ask
from dehyst.drivers.interface import DeviceTimeout, DriverConfigError, DriverError
from dehyst.drivers.kpz101 import Kpz101
from dehyst.drivers.ksg101 import Ksg101

PATIENCE_S = 20.0


@pytest.fixture(scope="module")
def ports(tmp_path_factory: pytest.TempPathFactory) -> Iterator[dict[str, str]]:
    words = ["--amplifier", "kpz101", "--limit-v", "75", "--start-v", "20"]
    with emulated_bench(tmp_path_factory.mktemp("bench"), *words) as ports:
        yield ports


@pytest.fixture
def amplifier(ports: dict[str, str]) -> Iterator[Kpz101]:
    ask(ports["control"], {"clear": True})
    device = Kpz101.from_settings({"port": ports["kpz101"], "timeout_s": 0.5})
    device.open()
    yield device
    device.close()


def test_volts_in_micrometres_out(ports: dict[str, str], amplifier: Kpz101) -> None:
    gauge = Ksg101.from_settings({"port": ports["ksg101"], "timeout_s": 1.0})
    gauge.open()
    assert (amplifier.spec.maximum, gauge.spec.unit) == (75.0, "um")
    amplifier.write(0.0)
    until(lambda: ask(ports["control"], {})["drive_v"] < 0.01)
    low_um = gauge.read()
    amplifier.write(75.0)
    until(lambda: ask(ports["control"], {})["drive_v"] > 74.99)
    assert gauge.read() > low_um + 3.0
    assert ask(ports["control"], {})["output_v"] == 75.0
    gauge.close()


def test_faults_from_the_control_socket(ports: dict[str, str], amplifier: Kpz101) -> None:
    amplifier.write(30.0)
    ask(ports["control"], {"amplifier": {"mute": True}})
    with pytest.raises(DeviceTimeout):
        amplifier.write(31.0)
    state = ask(ports["control"], {"clear": True, "fault": "unplug"})
    assert state["plugged"] == {"kpz101": False, "ksg101": True}
    with pytest.raises(DriverError):
        amplifier.write(32.0)
    assert ask(ports["control"], {"clear": True})["plugged"]["kpz101"]
    amplifier.reconnect()
    assert amplifier.output() == pytest.approx(31.0, abs=amplifier.spec.resolution)


@pytest.mark.parametrize(
    ("order", "says"),
    [
        ({"amplifier": {"hang": True}}, "hang"),
        ({"inputs": {"ext_v": 1.0}}, "KPZ101 has no"),
        ({"fault": "unplug", "device": "mdt693b"}, "kpz101, ksg101 or both"),
    ],
)
def test_orders_for_another_amplifier_are_refused(
    ports: dict[str, str], order: dict, says: str
) -> None:
    with pytest.raises(DriverConfigError, match=says):
        ask(ports["control"], order)


def test_set_up_recognises_both_units(ports: dict[str, str]) -> None:
    ask(ports["control"], {"clear": True})
    found = [ask_port(ports[name], "x") for name in ("kpz101", "ksg101")]
    kinds = [(unit.kind, unit.driver, unit.serial) for unit in found if unit]
    assert kinds == [("actuator", "kpz101", "29000123"), ("sensor", "ksg101", "59000123")]


@pytest.mark.parametrize(
    ("words", "says"),
    [
        (["--axes", "2"], "--axes: not for a KPZ101"),
        (["--dialect", "1.05"], "--dialect: not for a KPZ101"),
        (["--jitter-s", "0.2"], "--jitter-s: not for a KPZ101"),
    ],
)
def test_what_a_kpz101_does_not_have_is_refused(
    words: list[str], says: str, capsys: pytest.CaptureFixture
) -> None:
    assert main(["emulate", "--amplifier", "kpz101", *words]) == 2
    assert says in capsys.readouterr().err
