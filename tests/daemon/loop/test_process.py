"""The core as a real process: on the in-process stage at 1 kHz, and on the emulated bench."""

import signal
import time
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from tests.rigs.gateway_bench import STANDSTILL_S, longest_pause_s, skipped
from tests.rigs.output import check_range, check_speed, during
from tests.rigs.processes import SLEW, EmulatedBench, Rings, core, dehyst, simulated_config, until

from dehyst.daemon.files.models import load_model, save_model
from dehyst.daemon.rings.records import Flag, LoopCommand, MissCause, State
from dehyst.drivers.simulated.settings import StageSettings
from dehyst.drivers.simulated.stage import SimulatedStage
from dehyst.models.hysteresis.forward import simulate_hysteresis
from dehyst.models.model import Block, Validity


@pytest.fixture
def bench(tmp_path: Path) -> Iterator[EmulatedBench]:
    emulated = EmulatedBench(tmp_path)
    yield emulated
    emulated.close()


engines = pytest.mark.parametrize("engine", ['engine = "python"', 'engine = "compiled"'])


def own_misses(status: np.void) -> int:
    """Return the number of missed deadlines that the machine's stalls do not explain."""
    excused = (MissCause.STALL, MissCause.STEAL, MissCause.SUSPENDED, MissCause.PREEMPTED)
    return int(status["missed"] - sum(status["missed_by"][cause] for cause in excused))


def check_output(bench: EmulatedBench) -> None:
    """Check in the amplifier's own log that the output kept range and slew at every moment."""
    time_ns, volts = bench.output()
    check_range(volts, 0.0, 150.0)
    check_speed(time_ns, volts, SLEW, SLEW / 100.0)


@pytest.mark.timing
@pytest.mark.alone
@engines
def test_one_kilohertz_on_the_simulated_stage(tmp_path: Path, model: Path, engine: str) -> None:
    with core(simulated_config(tmp_path, 1000.0, model, engine)):
        rings = Rings(tmp_path)
        until(lambda: rings.read("telemetry").size > 500)
        begun = follow_nine(rings)
        said = rings.last("status")["samples"]
        until(lambda: rings.last("status")["samples"] > said, 5.0, "a status")
        status, records = rings.last("status"), rings.read("telemetry")
    check_grid(records, status)
    own = own_misses(status)
    assert own <= 0.02 * status["samples"], f"{own} missed by the loop: {status['missed_by']}"
    followed = np.flatnonzero(records["target"] == 9.0)
    # a set-point holds for a second; some samples may be missed
    late = skipped(records[records["seq"] >= begun], 1000.0)
    assert np.count_nonzero(records["seq"][followed] >= begun) > 700 - late
    check_reached(records, followed, model, float(status["origin"]))


def follow_nine(rings: Rings) -> int:
    """Send the set-point 9 and wait for two seconds; again, up to three times, where the loop stood
    still for most of the second for which a set-point holds. Return the first sample's number."""
    for _ in range(3):
        begun = int(rings.last()["seq"])
        rings.command(LoopCommand.SETPOINT, 9.0)
        until(lambda first=begun: rings.last()["seq"] > first + 2000)
        records = rings.read("telemetry")
        if longest_pause_s(records[records["seq"] >= begun]) <= STANDSTILL_S:
            return begun
    pytest.skip("nothing can be judged: the loop stood still in each of three attempts")


def check_grid(records: np.ndarray, status: np.void) -> None:
    """Check that every sample exists, lies on the grid and does not begin before its time, and that
    missed deadlines are counted: a sample that ends n periods after its deadline misses n, and the
    next one comes n later."""
    assert (np.diff(records["seq"]) == 1).all()
    gaps, odd = np.divmod(np.diff(records["scheduled_ns"]), 1_000_000)
    assert (odd == 0).all()
    assert (gaps >= 1).all()
    assert (records["actual_ns"] >= records["scheduled_ns"]).all()
    missed = records["flags"][:-1] & Flag.MISSED > 0
    assert (gaps[~missed] == 1).all()
    before = records["seq"][:-1] < status["samples"]
    assert status["missed"] == gaps[missed & before].sum()
    assert status["missed"] == status["missed_by"].sum()


def check_reached(records: np.ndarray, followed: np.ndarray, model: Path, origin: float) -> None:
    """Check that the voltages are the model's for the target, and the readings the stage's for the
    voltages.

    The difference between the two, due to creep and to what the model cannot know of the stage, is
    not the loop's error.
    """
    settled = followed[followed.size // 2 :]
    promised = (
        simulate_hysteresis(load_model(model).hysteresis, records["volts"], 1e-3)[settled] - origin
    )
    assert np.abs(promised - 9.0).max() < 1e-3
    t_s = (records["scheduled_ns"] - records["scheduled_ns"][0]) * 1e-9
    true_um, _ = SimulatedStage(StageSettings()).run(t_s, records["volts"])
    error = records["measured"][settled] + origin - true_um[settled]
    noise = StageSettings().sensor_noise_um
    assert noise / 2 < np.std(error) < 2 * noise  # the gauge's filter removes some of it
    assert abs(error.mean()) < 5 * noise / np.sqrt(settled.size / 20)  # and correlates neighbours


@engines
def test_sigterm_ramps_to_the_safe_voltage(tmp_path: Path, model: Path, engine: str) -> None:
    config = simulated_config(tmp_path, 500.0, model, engine)
    with core(config) as process:
        rings = Rings(tmp_path)
        rings.drive(9.0, lambda last: last["volts"] > 60.0)
        process.send_signal(signal.SIGTERM)
        assert process.wait(30) == 0
        records = rings.read("telemetry")
    assert records["volts"][-1] == 5.0
    assert State(records["state"][-1]) is State.STOPPING
    assert np.abs(np.diff(records["volts"])).max() <= SLEW / 500 * (1 + 1e-9)
    ramp = records["volts"][records["state"] == State.STOPPING]
    assert np.abs(np.diff(ramp)).max() <= 200.0 / 500 * (1 + 1e-9)


@engines
def test_reload_swaps_a_good_model_and_refuses_a_broken_one(
    tmp_path: Path, model: Path, engine: str
) -> None:
    own = tmp_path / "model.toml"
    good = model.read_text()
    own.write_text(good)
    with core(simulated_config(tmp_path, 500.0, own, engine)) as process:
        rings = Rings(tmp_path)
        rings.drive(9.0, lambda last: last["target"] == 9.0)
        for broken in ("", "format = 1", good.replace("format = 1", "format = 99"), good[:300]):
            own.write_text(broken)
            before = rings.events().count("refused")
            process.send_signal(signal.SIGHUP)
            until(lambda n=before: rings.events().count("refused") > n, 20, "refusal")
        own.write_text(good)
        process.send_signal(signal.SIGHUP)
        until(lambda: "model reloaded" in rings.events(), 20, "reload")
        assert "another stage's" not in rings.events()
        save_model(replace(load_model(own), validity=Validity(0.0, 10.0)), own)  # of 0 to 150 V
        process.send_signal(signal.SIGHUP)
        until(lambda: "it may be another stage's" in rings.events(), 20, "the warning")
        own.write_text(good)
        gain = {"gain_um_per_unit": 0.01, "reference": 0.0}
        coupled = Block("coupling", "stage", gain, "u2_v")
        save_model(replace(load_model(own), blocks=(coupled,)), own)
        process.send_signal(signal.SIGHUP)
        until(lambda: "not compensated: u2_v" in rings.events(), 20, "what is not measured")
        rings.command(LoopCommand.SETPOINT, 9.0)
        time.sleep(0.5)
        assert process.poll() is None
        volts = rings.read("telemetry")["volts"]
    assert np.abs(np.diff(volts)).max() <= SLEW / 500 * (1 + 1e-9)


def test_serial_bench_unplug_and_back(bench: EmulatedBench, model: Path) -> None:
    rings = Rings(bench.folder)
    with core(bench.config(100.0, model)):
        rings.drive(9.0, lambda last: last["volts"] > 60.0)
        bench.control(fault="unplug", device="mdt693b", for_s=1.5)
        rings.command(LoopCommand.SETPOINT, 4.0)
        until(lambda: rings.state() is State.FAULT, 20, "fault")
        until(lambda: rings.state() is not State.FAULT, 30, "recovery")
        until(lambda: "back" in rings.events(), 20, "the event")
        # on_fault = "ramp": it ramps to the safe voltage by itself
        until(lambda: rings.last()["volts"] == 5.0, 20, "safe voltage")
        rings.drive(3.0, lambda last: last["state"] == State.RUNNING)
        time.sleep(0.3)
        records = rings.read("telemetry")
    assert (np.diff(records["seq"]) == 1).all()
    check_output(bench)


def test_kill_9_then_safe_then_restart_without_a_jump(bench: EmulatedBench, model: Path) -> None:
    rings, config = Rings(bench.folder), bench.config(100.0, model)
    with core(config) as process:
        rings.drive(9.0, lambda last: last["volts"] > 60.0)
        process.send_signal(signal.SIGKILL)
        process.wait(10)
    left = rings.last()["volts"]
    assert left > 60.0
    begun_ns = time.monotonic_ns()
    safe = dehyst("safe", "--config", str(config))
    _, words = safe.communicate(timeout=60)
    assert safe.returncode == 0
    assert "5.000 V" in words
    time_ns, volts = during(*bench.output(), begun_ns)
    check_speed(time_ns, volts, 200.0, 2.0)  # 200 V/s of the ramp; two of its steps
    assert (time_ns[-1] - time_ns[0]) * 1e-9 > 0.9 * (left - 5.0) / 200.0
    with core(config):
        time.sleep(0.3)
        assert rings.last()["volts"] == pytest.approx(5.0, abs=0.4)
    check_output(bench)


def test_a_loop_faster_than_the_serial_line_is_refused(bench: EmulatedBench, model: Path) -> None:
    process = dehyst("core", "--config", str(bench.config(1000.0, model)))
    _, words = process.communicate(timeout=60)
    assert process.returncode == 2
    assert len(words.strip().splitlines()) == 1
    assert "loop.rate_hz = 1000" in words
    assert "mdt693b" in words
    assert "Hz" in words


def test_bad_configurations_end_in_one_line(tmp_path: Path, model: Path) -> None:
    path = simulated_config(tmp_path, 500.0, model)
    good = path.read_text()
    cases = {
        "sped = 3": good.replace("[loop]", "[loop]\nsped = 3"),
        "rate_hz": good.replace("rate_hz = 500.0", "rate_hz = -1.0"),
        "driver": good.replace('driver = "simulated"', 'driver = "nothing"'),
        "safe.voltage_v": good.replace("voltage_v = 5.0", "voltage_v = 500.0"),
        "limits": good.replace("max_v = 150.0", "max_v = 900.0"),
        "not a TOML": "]][",
    }
    for word, text in cases.items():
        path.write_text(text)
        process = dehyst("core", "--config", str(path))
        _, words = process.communicate(timeout=60)
        assert process.returncode == 2, (word, words)
        assert len(words.strip().splitlines()) == 1, words
        assert word.split(" ")[0] in words


@pytest.mark.timing
@engines
def test_a_trimmed_stage_stands_where_the_gauge_says(
    tmp_path: Path, model: Path, engine: str
) -> None:
    with core(simulated_config(tmp_path, 1000.0, model, engine, trim=True)):
        rings = Rings(tmp_path)
        until(lambda: rings.read("telemetry").size > 500)
        for _ in range(12):
            rings.command(LoopCommand.SETPOINT, 9.0)
            time.sleep(0.5)

        def undisturbed(_: np.void) -> bool:
            """Return whether the trim goes on, and the loop has not stood still for two seconds."""
            status, records = rings.last("status"), rings.read("telemetry")
            goes_on = (status["trimmed"], status["trim_frozen"]) == (1, 0)
            return goes_on and longest_pause_s(records[-2000:]) <= STANDSTILL_S

        rings.drive(9.0, undisturbed)
        status, records = rings.last("status"), rings.read("telemetry")
    newest = records[records["target"] == 9.0][-1000:]
    noise = StageSettings().sensor_noise_um
    assert abs(newest["measured"].mean() - 9.0) < 0.5 * noise
    assert abs(newest["trim"][-1]) > noise  # without trim it would be this far off
    assert (status["trimmed"], status["trim_frozen"]) == (1, 0)
    assert status["differs"] == pytest.approx(-newest["trim"][-1], abs=noise)
