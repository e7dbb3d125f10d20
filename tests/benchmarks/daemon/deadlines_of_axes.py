"""Deadlines of a core of one, two and three axes, and what an axis costs.

    python -m tests.benchmarks.daemon.deadlines_of_axes [--for SECONDS] [--rate HZ] [--serial HZ]

It runs the compiled loop on simulated stages, one for each axis, at --rate; then the Python loop on
the emulated MDT693B and KSG101s, at --serial: "auto" uses the rate that the unit sustains with
these axes. 0 skips either part. All axes follow set-points, so that all outputs are written.
Wake-up, computing time and missed deadlines come from the telemetry ring. Exit status: see
tests/benchmarks/bars.py.
"""

import argparse
import os
import re
import sys
import tempfile
import time
from collections import Counter
from pathlib import Path

import numpy as np
from tests.benchmarks.bars import Bars, too_busy
from tests.rigs.processes import EmulatedBench, Rings, core
from tests.rigs.two_loops import model

from dehyst.daemon.files.models import save_model
from dehyst.daemon.rings.records import Flag, LoopCommand, MissCause, name_of

MISSED_BAR = 1e-4
OURS = ("compute", "driver_io", "page_fault")
CONFIG = """
name = "axes"
run_dir = "{folder}/run"
[loop]
rate_hz = {rate}
cpu = {cpu}
[model]
file = "{folder}/model.toml"
[limits]
min_v = 0.0
max_v = 150.0
slew_v_per_s = 4000.0
[setpoint]
stale_s = 3600.0
"""
HEAD = (
    "axes loop       rate Hz | wake-up p50   p99  p99.9    max us | to end of write p50   p99 us |"
    " missed of samples | by cause"
)


def simulated(folder: Path, axes: str, rate: float, cpu: int) -> Path:
    """Write a configuration on simulated stages."""
    text = CONFIG.format(folder=folder, rate=rate, cpu=cpu)
    for axis in axes:
        device = f'{{driver = "simulated", settings = {{stage = "{axis}"}}}}'
        text += f"[axis.{axis}]\nactuator = {device}\nsensor = {device}\n"
    return written(folder, text)


def emulated(folder: Path, axes: str, rate: float, cpu: int, bench: EmulatedBench) -> Path:
    """Write a configuration on the emulated units."""
    text = CONFIG.format(folder=folder, rate=rate, cpu=cpu)
    text += f'[actuator]\ndriver = "mdt693b"\nsettings = {{port = "{bench.ports["mdt693b"]}"}}\n'
    for axis in axes:
        port = bench.ports[f"ksg101-{axis}"]
        text += f'[axis.{axis}]\nactuator.settings.axis = "{axis}"\n'
        text += f'sensor = {{driver = "ksg101", settings = {{port = "{port}"}}}}\n'
    return written(folder, text)


def written(folder: Path, text: str) -> Path:
    path = folder / "config.toml"
    path.write_text(text)
    return path


def measured(config: Path, axes: str, seconds: float) -> dict[str, np.ndarray]:
    """Return the telemetry of each axis while all of them follow set-points."""
    with core(config, axes[0]):
        rings = {axis: Rings(config.parent, axis) for axis in axes}
        for i, ring in enumerate(rings.values()):
            ring.command(LoopCommand.SETPOINT, 4.0 + i)
        time.sleep(2.5)  # warm-up and approach
        begun_ns = time.monotonic_ns()
        time.sleep(seconds)
        reported = {axis: ring.read("telemetry") for axis, ring in rings.items()}
    return {axis: records[records["scheduled_ns"] > begun_ns] for axis, records in reported.items()}


def sustained(
    folder: Path, axes: str, cpu: int, bench: EmulatedBench, seconds: float
) -> tuple[float, dict[str, np.ndarray]]:
    """Return (the highest rate that the daemon does not refuse, telemetry at it)."""
    rate = 1000.0
    for _ in range(8):
        try:
            return rate, measured(emulated(folder, axes, rate, cpu, bench), axes, seconds)
        except AssertionError as refused:
            offered = re.search(r"set loop.rate_hz to (\d+(?:\.\d+)?) or less", str(refused))
            if offered is None:
                raise
            rate = min(float(offered[1]), 0.97 * rate)
    raise RuntimeError(f"no rate is accepted, down to {rate:g} Hz")


def judge(axes: str, loop: str, rate: float, reported: dict[str, np.ndarray], bars: Bars) -> float:
    """Print one row; return the median time from wake-up to the end of the last write [us]."""
    records = reported[axes[0]]
    wake_us = (records["actual_ns"] - records["scheduled_ns"]) * 1e-3
    p50, p99, p999 = np.quantile(wake_us, [0.5, 0.99, 0.999])
    exec50, exec99 = np.quantile(records["exec_us"], [0.5, 0.99])
    missed = records[(records["flags"] & int(Flag.MISSED)) > 0]
    causes = Counter(name_of(MissCause, int(cause)) for cause in missed["cause"])
    said = ", ".join(f"{name} {n}" for name, n in causes.items()) or "-"
    print(
        f"{len(axes):4d} {loop:8} {rate:9.0f} | {p50:11.0f} {p99:5.0f} {p999:6.0f} "
        f"{wake_us.max():9.0f} | {exec50:19.1f} {exec99:8.1f} | "
        f"{missed.size:6d} of {records.size:7d} | {said}",
        flush=True,
    )
    ours = sum(causes[name] for name in OURS)
    share = 100 * ours / max(1, records.size)
    bars.most(f"{len(axes)} axes, {loop}: own missed deadlines", share, 100 * MISSED_BAR, "%")
    return float(exec50)


def main() -> int:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("--for", dest="seconds", type=float, default=10.0, help="at most 12")
    parser.add_argument("--rate", type=float, default=5000.0)
    parser.add_argument("--serial", default="auto")
    parser.add_argument("--cpu", type=int, default=max(os.sched_getaffinity(0)))
    args = parser.parse_args()
    bars, busy = Bars(), too_busy()
    if busy:
        print(busy)
    took: dict[str, dict[int, float]] = {"compiled": {}, "serial": {}}
    print(HEAD)
    with tempfile.TemporaryDirectory(prefix="dehyst-axes-") as name:
        for axes in ("x", "xy", "xyz") if args.rate else ():
            folder = Path(name) / f"simulated-{axes}"
            folder.mkdir()
            save_model(model(), folder / "model.toml")
            config = simulated(folder, axes, args.rate, args.cpu)
            reported = measured(config, axes, min(args.seconds, 12.0))
            took["compiled"][len(axes)] = judge(axes, "compiled", args.rate, reported, bars)
        for axes in ("x", "xy", "xyz") if args.serial != "0" else ():
            folder = Path(name) / f"serial-{axes}"
            folder.mkdir()
            save_model(model(), folder / "model.toml")
            bench = EmulatedBench(folder, "--axes", "3")
            try:
                if args.serial == "auto":
                    rate, reported = sustained(folder, axes, args.cpu, bench, args.seconds)
                else:
                    rate = float(args.serial)
                    config = emulated(folder, axes, rate, args.cpu, bench)
                    reported = measured(config, axes, args.seconds)
            finally:
                bench.close()
            took["serial"][len(axes)] = judge(axes, "serial", rate, reported, bars)
    for loop, by_axes in took.items():
        if len(by_axes) == 3:
            print(f"{loop}: {(by_axes[3] - by_axes[1]) / 2:.1f} us an axis more")
    return bars.end()


if __name__ == "__main__":
    sys.exit(main())
