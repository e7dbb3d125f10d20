"""`dehyst latency` as a process, and its verdict on made-up measurements."""

import json
import os
import subprocess
import sys
from argparse import Namespace
from pathlib import Path

import numpy as np
import pytest
from tests.rigs.processes import EmulatedBench

from dehyst.daemon.commands.latency import _default_hz, _setup
from dehyst.daemon.config import load_config, parse_config
from dehyst.daemon.latency.latency import LatencyOutcome, Setup, time_devices
from dehyst.daemon.latency.machine import advice
from dehyst.daemon.loop.timing.histogram import Histogram
from dehyst.daemon.loop.timing.realtime import IDLE_LATENCY, Obtained
from dehyst.daemon.main import main
from dehyst.drivers.emulated.control import ask


def dehyst(*arguments: str) -> "subprocess.CompletedProcess[str]":
    return subprocess.run(
        [sys.executable, "-m", "dehyst.daemon.main", "latency", *arguments],
        stdin=subprocess.DEVNULL, capture_output=True, text=True, timeout=110, check=False,
    )  # fmt: skip


@pytest.mark.parametrize("engine", ["compiled", "python"])
def test_measures_the_loop_and_says_so_in_json(engine: str) -> None:
    done = dehyst("--rate", "200", "--for", "1", "--no-io", "--json", "--engine", engine)
    assert done.stderr == ""
    found = json.loads(done.stdout)
    assert done.returncode == (0 if found["held"] else 1)
    assert found["samples"] == 200
    assert found["engine"] == engine
    assert found["policy"] in ("fifo", "other")
    for name in ("wake", "execution"):
        figures = list(found[name].values())
        assert figures == sorted(figures)
        assert figures[0] > 0
    assert found["missed"] == sum(found["missed_by"].values())


NI = '{driver = "nidaqmx", settings = {channel = "Dev1/ao0"}}'
BRIDGE = '{driver = "nidaqmx", settings = {channel = "Dev1/ai0", um_per_v_per_v = 8000.0}}'


@pytest.mark.parametrize(
    ("actuator", "sensor", "engine"),
    [
        (NI, BRIDGE, "compiled"),
        (NI, '{driver = "ksg101"}', "python"),
        ('{driver = "kpz101"}', BRIDGE, "python"),
    ],
)
def test_the_engine_is_the_one_that_the_devices_admit(
    actuator: str, sensor: str, engine: str
) -> None:
    config = parse_config(
        f'name = "a"\nmodel = {{file = "none"}}\nactuator = {actuator}\nsensor = {sensor}\n'
        "limits = {min_v = 0.0, max_v = 75.0, slew_v_per_s = 4000.0}\n"
    )
    options = ("rate", "engine", "priority", "cpu", "spin")
    args = Namespace(**dict.fromkeys(options), seconds=1.0)
    assert _setup(args, config, 100.0).engine == engine


def test_times_the_emulated_devices_and_refuses_what_they_cannot() -> None:
    done = dehyst("--rate", "5000", "--for", "0.5")
    assert done.returncode == 1  # no serial line reaches 5 kHz
    assert "write emulated MDT693B" in done.stdout
    assert "these devices allow about" in done.stdout
    assert "5000 Hz NOT held" in done.stdout
    assert "#" not in done.stdout  # no picture in a pipe


def test_a_configured_amplifier_is_timed_and_never_set(tmp_path: Path) -> None:
    bench = EmulatedBench(tmp_path, "--start-v", "30")
    try:
        io = time_devices(load_config(bench.config(100.0, tmp_path / "none.toml")))
        assert bench.output()[1].size <= 1  # the log begins with the initial output
        assert ask(bench.ports["control"], {})["sets"] == 0
    finally:
        bench.close()
    assert list(io) == ["read ksg101", "write mdt693b"]
    assert 1500.0 < io["write mdt693b"].quantile(0.5) < 10_000.0  # replies after 1.5 ms


@pytest.mark.parametrize("bad", [("--rate", "0"), ("--for", "-1"), ("--config", "/nowhere.toml")])
def test_bad_arguments_are_one_line(
    bad: tuple[str, str], capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["latency", *bad]) == 2
    assert len(capsys.readouterr().err.strip().splitlines()) == 1


def outcome(missed: int, io_us: float = 0.0) -> LatencyOutcome:
    io = Histogram()
    io.add(io_us)
    made = LatencyOutcome(Setup(1000.0), 100_000, missed, {"late_wake": missed}, io={"read": io})
    made.execution.add(20.0)
    return made


def test_a_rate_is_held_up_to_one_miss_in_ten_thousand_and_with_time_for_the_devices() -> None:
    assert outcome(0).held
    assert outcome(10).held
    assert not outcome(11).held
    assert outcome(0, 900.0).held
    assert not outcome(0, 1100.0).held
    assert not LatencyOutcome(Setup()).held


def test_one_miss_in_few_samples_says_nothing() -> None:
    one = LatencyOutcome(Setup(), 5000, 1)
    assert one.held
    assert not LatencyOutcome(Setup(), 5000, 2).held


def test_without_a_rate_it_is_what_the_devices_leave_room_for() -> None:
    io = Histogram()
    io.add(2000.0)
    assert _default_hz({"read": io, "write": io}) == pytest.approx(200.0, abs=20.0)
    assert _default_hz({}) == 1000.0


def test_misses_that_a_witness_explains_are_distinguished() -> None:
    made = LatencyOutcome(Setup(), 1000, 9, {"stall": 4, "driver_io": 3, "steal": 2})
    assert made.excused == 6


def test_advice_names_what_is_missing() -> None:
    found = {
        "isolated": "none", "governor": "powersave", "preemption": "no PREEMPT_RT",
        "virtual machine": "no sign of one",
    }  # fmt: skip
    words = " ".join(advice(found, Obtained(False, 0, False, (0, 1)), -1, 80, 1000.0))
    for word in (
        "LimitRTPRIO",
        "LimitMEMLOCK",
        "cpu_dma_latency",
        "governor",
        "timer slack",
        "PREEMPT_RT",
    ):
        assert word in words
    good = found | {"isolated": "1", "governor": "performance", "preemption": "PREEMPT_RT"}
    assert advice(good, Obtained(True, 80, True, (1,), (), True), 1, 80, 1000.0) == []


def test_histogram_keeps_all_windows_and_counts_every_duration_once() -> None:
    rng = np.random.default_rng(1)
    histogram, durations = Histogram(), rng.lognormal(3.0, 1.5, 3000)
    for i, us in enumerate(durations):
        if i % 700 == 699:
            histogram.clear()
        histogram.add(us)
    whole = histogram.whole()
    assert whole.maximum == durations.max()
    rows = whole.rows()
    assert sum(n for _, _, n in rows) == durations.size
    for low, high, n in rows:
        assert n == ((durations > low) & (durations <= high)).sum()
    assert whole.quantile(0.5) == pytest.approx(np.median(durations), rel=0.1)


@pytest.mark.skipif(not os.access(IDLE_LATENCY, os.R_OK | os.W_OK), reason=f"no {IDLE_LATENCY}")
def test_idle_states_are_bounded_while_the_process_lives() -> None:
    """The process keeps the CPUs out of deep idle states while it lives, and only then. The kernel
    itself reports the exit latency that all requests together allow."""

    def now() -> int:
        return int.from_bytes(Path(IDLE_LATENCY).read_bytes()[:4], "little", signed=True)

    code = "from dehyst.daemon.loop.timing.realtime import stay_awake; print(stay_awake()); input()"
    before = now()
    if before == 0:
        pytest.skip("another process keeps the CPUs awake")
    process = subprocess.Popen(
        [sys.executable, "-c", code], stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True
    )
    assert process.stdout is not None
    assert process.stdout.readline() == "True\n"
    during = now()
    process.communicate("\n", timeout=30)
    assert during == 0
    assert now() in (before, 0)  # 0: another process requested it meanwhile
