"""A missed deadline reports its cause: every cause that can be provoked from outside is
provoked."""

import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pytest
from tests.rigs.processes import Rings, core, simulated_config, until
from tests.rigs.stage_model import kept_model
from tests.rigs.two_loops import Rig

from dehyst.daemon.files.models import save_model
from dehyst.daemon.loop.python_loop import PythonLoop
from dehyst.daemon.rings.records import COMMAND, Flag, LoopCommand, MissCause

HOG = """
import os, sys, time
os.sched_setaffinity(0, {int(sys.argv[1])})
os.sched_setscheduler(0, os.SCHED_FIFO, os.sched_param(95))
for _ in range(16):
    end = time.monotonic() + 0.02
    while time.monotonic() < end:
        pass
    time.sleep(0.08)
"""


def may_use_fifo() -> bool:
    return subprocess.run(
        [sys.executable, "-c", "import os; os.sched_setscheduler(0, 1, os.sched_param(95))"],
        stderr=subprocess.DEVNULL, check=False,
    ).returncode == 0  # fmt: skip


def causes(records: np.ndarray) -> set[MissCause]:
    """Return the causes of the missed samples."""
    return {MissCause(int(c)) for c in records["cause"][records["flags"] & Flag.MISSED > 0]}


@pytest.mark.timing
@pytest.mark.alone
def test_a_slow_driver_is_named() -> None:
    rig = Rig("missed-driver")
    write, calls = rig.monitor.actuator.device.write, []

    def slow(volts: float) -> None:
        calls.append(volts)
        if len(calls) % 20 == 0:
            time.sleep(0.004)
        write(volts)

    PythonLoop(rig.monitor).run(5)  # load the kernels before a set-point's age counts
    rig.monitor.actuator.device.write = slow
    batch = np.zeros(1, COMMAND)
    batch["kind"], batch["value"] = LoopCommand.SETPOINT, 9.0
    rig.rings["command"].push_many(batch)
    PythonLoop(rig.monitor).run(155)
    records = rig.rings["telemetry"].read(0)[0]
    slow_ones = records[records["io_us"] > 3500]
    assert slow_ones.size >= 5
    assert (slow_ones["flags"] & Flag.MISSED > 0).all()
    assert (slow_ones["cause"] == MissCause.DRIVER_IO).mean() > 0.5  # a stall may coincide with one


@pytest.mark.timing
@pytest.mark.alone
@pytest.mark.parametrize("engine", ["python", "compiled"])
def test_a_higher_priority_and_a_stopped_process_are_named(tmp_path: Path, engine: str) -> None:
    if not may_use_fifo():
        pytest.skip("needs the privilege of FIFO scheduling (ulimit -r 95)")
    save_model(kept_model(), tmp_path / "model.toml")
    cpu = max(os.sched_getaffinity(0))
    lines = f'engine = "{engine}"\ncpu = {cpu}'
    rings = Rings(tmp_path)
    with core(simulated_config(tmp_path, 500.0, tmp_path / "model.toml", lines)) as process:
        until(lambda: rings.read("telemetry").size > 100)
        before = rings.read("telemetry").size
        hog = subprocess.run([sys.executable, "-c", HOG, str(cpu)], check=True)
        assert hog.returncode == 0
        preempted = rings.read("telemetry")[before:]
        before += preempted.size
        for _ in range(8):
            process.send_signal(signal.SIGSTOP)
            time.sleep(0.04)
            process.send_signal(signal.SIGCONT)
            time.sleep(0.06)
        suspended = rings.read("telemetry")[before:]
        status = until(
            lambda: s if (s := rings.last("status"))["missed_by"][MissCause.SUSPENDED] else None
        )
    long = preempted["actual_ns"] - preempted["scheduled_ns"] > 10_000_000
    assert long.sum() >= 4  # of 16; a busy machine may delay a hog past its turn
    assert (preempted["cause"][long] == MissCause.PREEMPTED).mean() > 0.6
    long = suspended["actual_ns"] - suspended["scheduled_ns"] > 25_000_000
    assert long.sum() >= 3
    assert (suspended["cause"][long] == MissCause.SUSPENDED).mean() > 0.6
    assert status["missed"] == status["missed_by"].sum()
