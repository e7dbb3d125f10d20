"""`dehyst probe` and `dehyst drivers`, as a user runs them, on an emulated unit."""

import json
import subprocess
import sys
from typing import Any

import pytest
from msgspec import structs

from dehyst.daemon.main import main
from dehyst.drivers.emulated.amplifiers import AptEmulator
from dehyst.drivers.emulated.kpc101_unit import RACK_KNOBS, Bpc303Unit, Kpc101Knobs, Kpc101Unit
from dehyst.drivers.emulated.kpz101_knobs import Kpz101Knobs
from dehyst.drivers.emulated.kpz101_unit import Kpz101Unit
from dehyst.drivers.emulated.ksg101_knobs import Ksg101Knobs
from dehyst.drivers.emulated.ksg101_unit import Ksg101Unit
from dehyst.drivers.emulated.mdt693b_knobs import Mdt693bKnobs
from dehyst.drivers.emulated.mdt693b_port import Mdt693bEmulator
from dehyst.drivers.emulated.pty_device import PtyServer
from dehyst.drivers.kpc101.probe import interpret_channels
from dehyst.drivers.ksg101.probe import REQUESTS, interpret_gauge_requests
from dehyst.drivers.ksg101.probe import GaugeProbeTuning as GaugeTuning
from dehyst.drivers.mdt693b.probe import QUERIES, interpret
from dehyst.drivers.mdt693b.tuning import ProbeTuning
from dehyst.drivers.recorded import RecordedExchange
from dehyst.drivers.registry import list_plugins


def exchange_of(table: dict[str, Any]) -> RecordedExchange:
    """Read an exchange back from the fixture file's form."""
    received = tuple((float(at_s), d.encode("latin-1")) for at_s, d in table["received"])
    return RecordedExchange(table["sent"].encode("latin-1"), float(table["sent_at_s"]), received)


@pytest.fixture(autouse=True)
def _short_silences(monkeypatch):
    hurried = ProbeTuning(quiet_s=0.03, first_byte_s=0.5)
    monkeypatch.setattr("dehyst.drivers.mdt693b.probe.TUNING", hurried)
    monkeypatch.setattr("dehyst.drivers.ksg101.probe.TUNING", GaugeTuning(0.2, 0.02))


@pytest.mark.parametrize("dialect", ["1.05", "1.10"])
def test_a_unit_is_recorded_and_understood(tmp_path, capsys, dialect):
    fixture = tmp_path / "unit.json"
    knobs = Mdt693bKnobs(dialect=dialect, latency_s=0.0, jitter_s=0.0, start_v=20.0)
    with Mdt693bEmulator(tmp_path / "port", knobs) as emulator:
        assert main(["probe", emulator.port, "-o", str(fixture), "--json"]) == 0
        assert emulator.unit.sets_done == 0
        assert emulator.unit.registers.echo, "a setting was changed"
        assert emulator.output_v() == pytest.approx(20.0, abs=2e-3)
    printed = json.loads(capsys.readouterr().out)
    assert printed["firmware"] == dialect
    assert printed["answers"]["vlimit?"] == "150"
    assert not [a for a in printed["answers"].values() if "unclear" in a or a == "no answer"]
    assert printed["timings"]["query"]["rate_hz"] > 0
    assert "set" not in printed["timings"]
    table = json.loads(fixture.read_text())
    exchanges = [exchange_of(entry) for entry in table["exchanges"]]
    assert [e.sent for e in exchanges] == [q.encode() + b"\r" for q in QUERIES]
    assert all(e.received[0][0] >= e.sent_at_s for e in exchanges)
    assert interpret(exchanges).answers == printed["answers"]


def test_an_mdt694b_is_named(tmp_path, capsys):
    knobs = Mdt693bKnobs(axes="x", latency_s=0.0, jitter_s=0.0)
    with Mdt693bEmulator(tmp_path / "port", knobs) as emulator:
        assert main(["probe", emulator.port]) == 0
        assert "MDT694B, firmware 1.10" in capsys.readouterr().out


def test_sets_are_timed_only_where_the_output_stands(tmp_path, capsys):
    knobs = Mdt693bKnobs(latency_s=0.0, jitter_s=0.0, start_v=20.0)
    with Mdt693bEmulator(tmp_path / "port", knobs) as emulator:
        assert main(["probe", emulator.port, "--sets", "40"]) == 2
        assert "Nothing was set" in capsys.readouterr().err
        assert emulator.unit.sets_done == 0
        assert main(["probe", emulator.port, "--sets", "20"]) == 0
        assert "set:" in capsys.readouterr().out
        assert emulator.unit.sets_done > 0
        assert emulator.output_v() == pytest.approx(20.0, abs=2e-3)


def test_a_silent_or_strange_port_is_a_finding(tmp_path, capsys):
    with Mdt693bEmulator(tmp_path / "port") as emulator:
        emulator.fault(mute=True)
        emulator.call(lambda: setattr(emulator.unit.registers, "echo", False))
        assert main(["probe", emulator.port]) == 1
        assert "does not answer" in capsys.readouterr().out
        emulator.fault(mute=False, garbage=True, count=1000)
        assert main(["probe", emulator.port]) == 1
        assert (
            "which is not an MDT693B, MDT694B, KPZ101, KSG101, KPC101 or BPC303"
            in capsys.readouterr().out
        )
    assert main(["probe", emulator.port]) == 2
    assert "there is no port" in capsys.readouterr().err


def test_a_gauge_reader_is_recorded_and_understood(tmp_path, capsys):
    fixture = tmp_path / "gauge.json"
    unit = Ksg101Unit(Ksg101Knobs(max_travel_um=40.0), lambda time_s: 12.5)
    with PtyServer(unit, tmp_path / "gauge") as server:
        assert main(["probe", server.port, "-o", str(fixture), "--json"]) == 0
        printed = json.loads(capsys.readouterr().out)
        assert main(["probe", server.port]) == 0
        assert "100 % is 40 um; it reads 12.5" in capsys.readouterr().out
        assert main(["probe", server.port, "--unit", "mdt693b"]) == 1
        assert "does not answer" in capsys.readouterr().out
    assert (printed["unit"], printed["travel_um"]) == ("ksg101", 40.0)
    assert printed["reading_um"] == pytest.approx(12.5, abs=40.0 / 32767)
    assert printed["gauge_connected"]
    assert not printed["zeroed"]
    assert printed["timings"]["reading"]["count"] == 100
    exchanges = [exchange_of(e) for e in json.loads(fixture.read_text())["exchanges"]]
    assert len(exchanges) == len(REQUESTS)
    assert exchanges[1].sent == bytes.fromhex("050000005001")  # MGMSG_HW_REQ_INFO
    assert exchanges[4].sent == bytes.fromhex("dd0701005001")
    assert interpret_gauge_requests(exchanges).answers == printed["answers"]


def test_drivers_lists_every_plugin(capsys):
    code = main(["drivers", "--json"])
    listed = json.loads(capsys.readouterr().out)
    assert {"mdt693b", "ksg101", "simulated"} <= {entry["name"] for entry in listed}
    assert code == (1 if any(entry["error"] for entry in listed) else 0)
    main(["drivers"])
    assert "mdt693b" in capsys.readouterr().out


def test_drivers_with_a_name_lists_the_settings_of_both_kinds(capsys):
    assert main(["drivers", "nidaqmx", "--json"]) == 0
    listed = {entry["kind"]: entry["settings"] for entry in json.loads(capsys.readouterr().out)}
    scale = next(key for key in listed["sensor"] if key["name"] == "um_per_v_per_v")
    assert (scale["required"], scale["unit"]) == (False, "um per V per V")
    assert next(key for key in listed["sensor"] if key["name"] == "channel")["required"]
    assert "displacement per bridge ratio" in scale["meaning"]
    gain = next(key for key in listed["actuator"] if key["name"] == "gain")
    assert (gain["default"], gain["type"]) == (15.0, "a number")
    assert main(["drivers", "mdt693b"]) == 0
    assert "longest wait for a reply" in capsys.readouterr().out
    assert main(["drivers", "mdt692b"]) == 2
    said = capsys.readouterr().err
    assert "no driver 'mdt692b' (" in said
    names = sorted({plugin.name for plugin in list_plugins()})
    assert said.strip().rpartition("the drivers are: ")[2].split(", ") == names


def test_the_emulator_as_a_process_takes_commands(tmp_path):
    command = [sys.executable, "-m", "dehyst.drivers.emulated.mdt693b_port"]
    command += ["--link", str(tmp_path / "port"), "--start-v", "7"]
    lines = "state\nfault hang on\nfault hang maybe\nfault before_reply 0a\nunplug\nplug 1.05\n"
    lines += "stall on\nclear\nnonsense\nquit\n"
    done = subprocess.run(command, input=lines, capture_output=True, text=True, timeout=60)
    ready, state, hang, maybe, before, out, back, stall, clear, bad, end = [
        json.loads(line) for line in done.stdout.splitlines()
    ]
    assert done.returncode == 0
    assert ready == {"ready": str(tmp_path / "port")}
    assert state["outputs_v"]["x"] == pytest.approx(7.0, abs=2e-3)
    assert [x["ok"] for x in (hang, before, out, back, stall, clear, end)] == [True] * 7
    assert (out["plugged"], back["plugged"]) == (False, True)
    assert not maybe["ok"]
    assert "commands:" in bad["error"]


@pytest.mark.parametrize("unit", [[], ["--unit", "kpz101"]])
def test_a_piezo_driver_is_recognised_and_not_touched(tmp_path, capsys, unit):
    knobs = Kpz101Knobs(limit_v=75, start_v=30.0, mode=2)
    with AptEmulator(Kpz101Unit(knobs), tmp_path / "port") as emulator:
        assert main(["probe", emulator.port, *unit, "--json"]) == 0
        assert (emulator.unit.sets_done, emulator.unit.output_v()) == (0, 0.0)
    found = json.loads(capsys.readouterr().out)
    assert (found["unit"], found["model"], found["serial"]) == ("kpz101", "KPZ101", "29000123")
    assert (found["limit_v"], found["enabled"], found["open_loop"]) == (75.0, False, False)
    assert found["output_v"] == pytest.approx(30.0, abs=0.01)


def test_a_kpc101_and_its_gauge_are_recorded_and_not_touched(tmp_path, capsys):
    fixture, moves = tmp_path / "unit.json", []
    knobs = Kpc101Knobs(limit_v=100, start_v=30.0, max_travel_um=40.0)
    unit = Kpc101Unit(knobs, lambda *move: moves.append(move), lambda channel, time_s: 12.5)
    with PtyServer(unit, tmp_path / "port") as server:
        assert main(["probe", server.port, "-o", str(fixture), "--json"]) == 0
        found = json.loads(capsys.readouterr().out)
        assert main(["probe", server.port, "--unit", "kpc101"]) == 0
    said = capsys.readouterr().out
    assert "KPC101, firmware 1.0.3, serial number 113000123; driver kpc101" in said
    assert "channel 1, actuator and sensor: voltage limit 100 V; set-point 30.0" in said
    assert "output disabled; 100 % is 40 um; it reads 12.5" in said
    assert (moves, unit.sets_done) == ([], 0)
    assert (found["unit"], found["serial"]) == ("kpc101", "113000123")
    (channel,) = found["channels"]
    assert (channel["roles"], channel["limit_v"]) == (["actuator", "sensor"], 100.0)
    assert channel["position_um"] == pytest.approx(12.5, abs=40.0 / 32767)
    exchanges = [exchange_of(e) for e in json.loads(fixture.read_text())["exchanges"]]
    assert exchanges[1].sent == bytes.fromhex("050000005001")
    assert [c.position_um for c in interpret_channels(exchanges)] == [channel["position_um"]]


def test_a_rack_is_recognised_with_its_bays_and_their_roles(tmp_path, capsys):
    knobs = structs.replace(RACK_KNOBS, bays=2, mode=2, start_v=30.0)
    unit = Bpc303Unit(knobs, position=lambda channel, time_s: float(channel))
    unit.channels[0x22].gauge_connected = False
    with PtyServer(unit, tmp_path / "port") as server:
        assert main(["probe", server.port, "--json"]) == 0
        found = json.loads(capsys.readouterr().out)
        assert main(["probe", server.port]) == 0
    said = capsys.readouterr().out
    assert (found["unit"], found["model"], found["serial"]) == ("bpc303", "BPC303", "71000123")
    assert [c["number"] for c in found["channels"]] == [1, 2]  # bay 3 is empty
    assert [c["roles"] for c in found["channels"]] == [["actuator", "sensor"], ["actuator"]]
    assert found["channels"][0]["position_um"] == pytest.approx(1.0, abs=1e-3)
    assert "channel 2, actuator: voltage limit 150 V" in said
    assert "channel 2 is not in open loop: the driver refuses it" in said
    assert [c.sets_done for c in unit.channels.values()] == [0, 0]


CONFIG = """
name = "probed"
run_dir = "{folder}"
model = {{file = "none"}}
limits = {{min_v = 0.0, max_v = 100.0, slew_v_per_s = 4000.0}}
[actuator]
driver = "{actuator}"
settings = {{{settings}}}
[sensor]
driver = "simulated"
settings = {{stage = "probed", sensor_noise_um = 0.0}}
"""


def test_the_devices_of_a_configuration_of_any_driver(tmp_path, capsys):
    (tmp_path / "bought.py").write_text("class Amplifier:\n    volts = 12.5\n")
    settings = 'object = "bought:Amplifier", write = "volts", output = "volts", max_v = 120.0, '
    settings += f'folder = "{tmp_path}"'
    path = tmp_path / "stage.toml"
    path.write_text(CONFIG.format(folder=tmp_path, actuator="python", settings=settings))
    assert main(["probe", "--config", str(path), "--json"]) == 0
    found = json.loads(capsys.readouterr().out)
    actuator, sensor = found["actuator"], found["sensor"]
    assert (actuator["identity"], actuator["stands_at"]) == ("Amplifier of bought:Amplifier", 12.5)
    assert (actuator["minimum"], actuator["maximum"], actuator["compiled"]) == (0.0, 120.0, False)
    assert 0.0 < 1.0 / actuator["max_rate_hz"] < 1.0
    assert (sensor["driver"], sensor["unit"], sensor["compiled"]) == ("simulated", "um", True)
    assert main(["probe", "--config", str(path)]) == 0
    said = capsys.readouterr().out
    assert "actuator: python: Amplifier of bought:Amplifier" in said
    assert "0 to 120 V in steps of 0 V; now at 12.5 V" in said
    assert "Hz sustained; Python loop" in said


@pytest.mark.parametrize(
    ("words", "says"),
    [
        ([], "give a PORT, or --config FILE"),
        (["/dev/ttyACM0", "--config", "stage.toml"], "give a PORT, or --config FILE"),
        (["--config", "stage.toml", "--sets", "3"], "--sets goes with a PORT"),
    ],
)
def test_a_port_or_a_configuration(words, says, capsys):
    assert main(["probe", *words]) == 2
    assert says in capsys.readouterr().err
