"""Cost of the gateway: telemetry at 1 and 10 kHz to a subscriber, and latency of a set-point.

python tests/benchmarks/daemon/gateway_load.py [SECONDS]

A separate process writes the rings at the given rate; gateway and subscriber are processes as well.
CPU is user and system time of the gateway per second. `age` is the time from the loop's wake-up to
the reception by the subscriber and includes half a batch on average. `bare` is a plain zenoh
publisher's CPU time for the same bytes at the same rate. `set-point` is the time from the client's
call to the record in the loop's ring.
"""

import json
import multiprocessing
import os
import sys
import tempfile
import time
from pathlib import Path

import numpy as np
import zenoh
from tests.benchmarks.bars import Bars, too_busy
from tests.rigs.gateway_bench import Bench, free_port

from dehyst.daemon.bus import encoding
from dehyst.daemon.gateway.core_rings import LAYOUTS
from dehyst.daemon.rings.records import TELEMETRY, State
from dehyst.daemon.rings.ring import Ring
from dehyst.daemon.rings.status import STATUS

SIZES = {"telemetry": 65536, "status": 256, "event": 256, "command": 65536}

MOST_CPU, MOST_AGE_MS, MOST_SETPOINT_US = 10.0, 50.0, 5000.0
"""Bars: at least twice what was measured on a quiet machine with two processors (3.4 %, 23 ms), so
that they detect a fundamental change but not a slower machine. A batch is 20 ms long."""


def writer(directory: str, rate_hz: float, stop: "multiprocessing.synchronize.Event") -> None:
    """Write rings as a core would, in groups of 1 ms."""
    rings = {
        name: Ring.create(Path(directory) / f"{name}.ring", dtype, SIZES[name])
        for name, dtype in LAYOUTS.items()
    }
    group = max(1, round(rate_hz / 1000))
    samples = np.zeros(group, TELEMETRY)
    samples["state"], samples["target"] = State.READY, 1.0
    status = np.zeros(1, STATUS)[0]
    status["state"], status["reach_max"], status["period_ns"] = State.READY, 10.0, 1e9 / rate_hz
    seq, due_ns, said_ns = 0, time.monotonic_ns(), 0
    while not stop.is_set():
        due_ns += round(group / rate_hz * 1e9)
        time.sleep(max(0.0, (due_ns - time.monotonic_ns()) * 1e-9))
        now_ns = time.monotonic_ns()
        samples["seq"] = np.arange(seq, seq + group)
        samples["scheduled_ns"] = samples["actual_ns"] = now_ns
        rings["telemetry"].push_many(samples)
        rings["command"].taken(rings["command"].head)
        seq += group
        if now_ns - said_ns > 1_000_000_000:
            said_ns = now_ns
            status["time_ns"], status["samples"] = now_ns, seq
            rings["status"].push(status)


def cpu_s(pid: int) -> float:
    """Return the user and system time of a process."""
    fields = Path(f"/proc/{pid}/stat").read_text().rsplit(")", 1)[1].split()
    return (int(fields[11]) + int(fields[12])) / os.sysconf("SC_CLK_TCK")


def telemetry(bench: Bench, seconds: float) -> tuple[int, int, float, np.ndarray]:
    """Return (samples, lost, gateway CPU share, ages in ms)."""
    client = bench.client()
    stream = client.stream()
    stream.read(1.0)
    assert bench.gateway is not None
    before_s, begun, count = cpu_s(bench.gateway.pid), time.monotonic(), 0
    first_lost, ages = stream.lost, []
    while time.monotonic() - begun < seconds:
        samples = stream.read(0.5)
        count += samples.size
        ages.append((time.monotonic_ns() - samples["actual_ns"]) * 1e-6)
    share = (cpu_s(bench.gateway.pid) - before_s) / (time.monotonic() - begun)
    return count, stream.lost - first_lost, share, np.concatenate(ages)


def setpoints(bench: Bench, count: int = 300) -> np.ndarray:
    """Return microseconds from put() to the record in the command ring."""
    client = bench.client()
    ring = Ring.attach(bench.config.directory / "command.ring", LAYOUTS["command"])
    client.send(1.0)
    out = []
    for i in range(count):
        head, begun = ring.head, time.monotonic_ns()
        client.put(1.0 + i % 5)
        while ring.head == head and time.monotonic_ns() - begun < 1_000_000_000:
            pass
        out.append((time.monotonic_ns() - begun) * 1e-3)
        time.sleep(0.003)
    return np.array(out)


def bare(rate_hz: float, batch_s: float, seconds: float) -> float:
    """Return the CPU share of this process while it puts the same bytes with zenoh alone."""
    port = free_port()
    config = zenoh.Config()
    config.insert_json5("listen/endpoints", json.dumps([f"tcp/127.0.0.1:{port}"]))
    config.insert_json5("scouting/multicast/enabled", "false")
    size = round(rate_hz * batch_s)
    payload = encoding.encode(encoding.batch(np.zeros(size, TELEMETRY), 1, "um", 0))
    reader = multiprocessing.get_context("spawn").Process(target=listener, args=(port,))
    with zenoh.open(config) as session:
        publisher = session.declare_publisher("bare/x")
        reader.start()
        while not publisher.matching_status.matching:
            time.sleep(0.05)
        before_s, begun = cpu_s(os.getpid()), time.monotonic()
        while time.monotonic() - begun < seconds:
            publisher.put(payload)
            time.sleep(batch_s)
        share = (cpu_s(os.getpid()) - before_s) / (time.monotonic() - begun)
    reader.join(5.0)
    reader.kill()
    return share


def listener(port: int) -> None:
    """Subscribe until the publisher has gone."""
    config = zenoh.Config()
    config.insert_json5("mode", '"client"')
    config.insert_json5("connect/endpoints", json.dumps([f"tcp/127.0.0.1:{port}"]))
    config.insert_json5("scouting/multicast/enabled", "false")
    with zenoh.open(config) as session:
        session.declare_subscriber("bare/x", lambda sample: None)
        while list(session.info.peers_zid()) + list(session.info.routers_zid()):
            time.sleep(0.2)


def main() -> int:
    """Print the table and the bars."""
    busy, bars = too_busy(), Bars()
    seconds = float(sys.argv[1]) if len(sys.argv) > 1 else 10.0
    context = multiprocessing.get_context("spawn")
    print(
        "rate     samples   lost  gateway CPU  bare put CPU  age p50/p99 ms  set-point p50/p99 us"
    )
    for rate_hz in (1000.0, 10_000.0):
        with tempfile.TemporaryDirectory() as folder:
            bench = Bench(Path(folder), start=False, **{"rate_hz = 200.0": f"rate_hz = {rate_hz}"})
            stop = context.Event()
            process = context.Process(
                target=writer, args=(str(bench.config.directory), rate_hz, stop)
            )
            process.start()
            try:
                bench.start_gateway()
                count, lost, share, ages = telemetry(bench, seconds)
                delays = setpoints(bench)
            finally:
                bench.close()
                stop.set()
                process.join()
        alone = bare(rate_hz, bench.config.telemetry.batch_s, seconds / 2)
        p50, p99 = np.percentile(ages, [50, 99])
        d50, d99 = np.percentile(delays, [50, 99])
        print(
            f"{rate_hz / 1e3:4.0f} kHz {count:8d} {lost:6d}  {100 * share:9.1f} % "
            f"{100 * alone:11.1f} %  {p50:6.1f} / {p99:5.1f}  {d50:8.0f} / {d99:.0f}"
        )
        name = f"{rate_hz / 1e3:g} kHz: "
        bars.none(name + "samples lost", lost)
        if busy:
            bars.cannot(name + "cost and ages", busy)
            continue
        bars.most(name + "gateway's processor time", 100 * share, MOST_CPU, "% of a core")
        bars.most(name + "age of a sample, p99", p99, MOST_AGE_MS, "ms")
        bars.most(name + "set-point, p99", d99, MOST_SETPOINT_US, "us")
    return bars.end()


if __name__ == "__main__":
    sys.exit(main())
