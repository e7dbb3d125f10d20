"""Deadlines of the loop against cyclictest, in the same window, on the same CPU.

    python -m tests.benchmarks.daemon.deadlines [--for SECONDS] [--rates 1000,10000] [--loads idle]

The core runs as in production (its own process, FIFO 80, pinned, with its witness) on the
in-process simulated stage, following a set-point. cyclictest runs at the same time on the same CPU
at a higher priority, so it never waits for the loop. `--loads served,doctor --repeat 3` compares
the loads `served` (the gateway alone) and `doctor` (gateway, a page viewed in a browser, and a
doctor that examines case after case). The benchmark then measures telemetry at a subscriber and its
cost, and one start. Without cyclictest (Debian: rt-tests) its columns are omitted and bars relative
to it are not judged. Exit status: see tests/benchmarks/bars.py.
"""

import argparse
import os
import subprocess
import sys
import tempfile
import time
from pathlib import Path

import numpy as np
from tests.benchmarks.bars import Bars, too_busy
from tests.benchmarks.daemon.deadline_parts import Core, Window, measure
from tests.rigs.gateway_bench import free_port

from dehyst.daemon.bus import encoding
from dehyst.daemon.bus.session import Bus
from dehyst.daemon.bus.topics import TELEMETRY as TOPIC
from dehyst.daemon.rings.records import TELEMETRY

LOADS = ("idle", "cpu", "subscribers", "gateway", "served", "doctor")
RATIO_BAR, MISSED_BAR, START_BAR_S = 1.2, 1e-4, 3.0


def row(window: Window) -> str:
    p50, p99, p999 = np.quantile(window.wake_us, [0.5, 0.99, 0.999])
    c = window.reference()
    ours = f"{p50:6.0f}{p99:6.0f}{p999:7.0f}{window.wake_us.max():8.0f}"
    theirs = (
        f"{c['p50']:6.0f}{c['p99']:6.0f}{c['p99.9']:7.0f}{c['max']:8.0f}"
        f"{window.too_late:8.3%}{p999 / c['p99.9']:7.2f}"
        if len(c) == 4
        else f"{'no cyclictest':>42}"
    )
    causes = ", ".join(f"{name} {n}" for name, n in window.by.items()) or "-"
    return (
        f"{window.rate:6.0f} {window.load:12}|{ours} |{theirs} |{window.exec_us:6.1f}"
        f"{window.missed:6d}{window.outside:5d} of {window.samples:7d} |{window.rss_kb:6d}"
        f"{window.faults[0]:5d}{window.faults[1]:4d} | {causes}"
    )


HEAD = (
    f"{'':19}|{'loop: wake-up, us':^27} |{'cyclictest, us':^27}{'missed':>8}{'p99.9':>7} |"
    f"{'exec':>6}{'missed deadlines':^22} |{'RSS':>6}{'faults':>9} |\n"
    f"{'  Hz load':19}|{'p50':>6}{'p99':>6}{'p99.9':>7}{'max':>8} |{'p50':>6}{'p99':>6}"
    f"{'p99.9':>7}{'max':>8}{'':>8}{'ratio':>7} |{'us':>6}{'all':>6}{'own':>5}{'':11} |{'kB':>6}"
    f"{'min':>5}{'maj':>4} | missed by"
)


def judge(window: Window, bars: Bars) -> None:
    """Judge the bars of this window. A missed deadline counts against the loop if no stall of the
    witness and no preemption explains it."""
    c = window.reference()
    name = f"{window.rate:g} Hz, {window.load}: "
    if window.rate <= 1000:
        if len(c) == 4:
            ratio = float(np.quantile(window.wake_us, 0.999)) / c["p99.9"]
            bars.most(name + "p99.9 over cyclictest's", ratio, RATIO_BAR)
        else:
            bars.cannot(name + "p99.9 over cyclictest's", "cyclictest did not run")
        bars.none(name + "own missed deadlines", window.outside)
    else:
        share = 100 * window.outside / max(1, window.samples)
        bars.most(name + "own missed deadlines", share, 100 * MISSED_BAR, "%")
    bars.none(name + "page faults in the loop", sum(window.faults))
    for heard, expected, lost, _ in window.subscribers:
        if lost or heard != expected:
            bars.add(name + "a subscriber heard", str(heard), str(expected), False)


def telemetry_cost(rate: float) -> str:
    """Return the cost of a published sample, and its ratio to a bare put of the same bytes; one
    subscriber."""
    count = max(1, round(0.02 * rate))
    samples = np.zeros(count, TELEMETRY)
    samples["seq"] = np.arange(count)
    samples["scheduled_ns"] = np.arange(count) * round(1e9 / rate)
    address, key = f"tcp/127.0.0.1:{free_port()}", "dehyst/@v1/bench/pubsub/telemetry/core"
    with Bus.serve((address,), ()) as bus, Bus.connect([address]) as other:
        other.listen(key, lambda _key, _payload: None)
        sender = bus.sender(key, TOPIC)
        time.sleep(0.5)
        payload = encoding.encode(encoding.batch(samples, 1, "um", 0))

        def whole() -> None:
            sender.put(encoding.encode(encoding.batch(samples, 1, "um", 0)))

        def bare() -> None:
            sender.put(payload)

        best = {}
        for name, call in (("whole", whole), ("bare", bare)) * 5:
            begin = time.perf_counter()
            for _ in range(400):
                call()
            took = (time.perf_counter() - begin) / 400 / count * 1e6
            best[name] = min(took, best.get(name, took))
    return (
        f"{rate:6.0f} Hz, batches of {count:3d}: {best['whole']:.3f} us a sample, bare put of the "
        f"same {len(payload)} bytes {best['bare']:.3f} us; ratio {best['whole'] / best['bare']:.2f}"
    )


def start_s(folder: Path, cpu: int) -> float:
    """Return seconds from exec to the first sample, kernels cached. One start, not the best."""
    core = Core(folder, 1000.0, cpu, "auto", free_port())
    core.close()
    return core.start_s


def slowest_imports() -> str:
    """Return the imports that take the most time of a start."""
    done = subprocess.run(
        [sys.executable, "-X", "importtime", "-c", "import dehyst.daemon.loop.process"],
        stderr=subprocess.PIPE, text=True, check=True,
    )  # fmt: skip
    rows = [line.split("|") for line in done.stderr.splitlines() if line.count("|") == 2]
    times = {r[2].strip(): int(r[1]) for r in rows if r[1].strip().isdigit()}
    wanted = ("dehyst.daemon.loop.process", "numba", "numpy", "scipy", "scipy.optimize", "msgspec")
    return ", ".join(f"{n} {times[n] * 1e-3:.0f} ms" for n in wanted if n in times)


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("--for", dest="seconds", type=float, default=20.0)
    parser.add_argument("--repeat", type=int, default=1, help="windows a row, each with a new core")
    parser.add_argument("--rates", default="1000,5000,10000")
    parser.add_argument("--loads", default=",".join(LOADS))
    parser.add_argument("--engine", default="auto", choices=("auto", "compiled", "python"))
    parser.add_argument("--cpu", type=int, default=max(os.sched_getaffinity(0)))
    args = parser.parse_args()
    busy, bars = too_busy(), Bars()
    memory = Path("/dev/shm") if Path("/dev/shm").is_dir() else None
    with tempfile.TemporaryDirectory(prefix="dehyst-bench-", dir=memory) as name:
        folder = Path(name)
        begun_s = start_s(folder, args.cpu)
        print(f"load average {os.getloadavg()[0]:.1f}; {args.seconds:g} s a window\n{HEAD}")
        for rate in (float(r) for r in args.rates.split(",")):
            for load in args.loads.split(","):
                window = Window(rate, load)
                for _ in range(args.repeat):
                    core = Core(folder, rate, args.cpu, args.engine, free_port())
                    try:
                        time.sleep(2.5)  # warm-up
                        window.add(measure(core, rate, args.cpu, load, args.seconds))
                    finally:
                        core.close()
                print(row(window), flush=True)
                judge(window, bars)
                if window.subscribers:
                    heard = sum(s[0] for s in window.subscribers)
                    expected = sum(s[1] for s in window.subscribers)
                    again = sum(s[3] for s in window.subscribers)
                    print(
                        f"{'':19}| {len(window.subscribers)} subscribers heard {heard} of "
                        f"{expected} samples, {again} of them from the history"
                    )
    print("\ntelemetry: cost in the gateway's thread")
    for rate in (1000.0, 10_000.0):
        print(f"  {telemetry_cost(rate)}")
    print(f"\nstart to first sample: {begun_s:.2f} s")
    print(f"imports: {slowest_imports()}")
    if busy:
        bars.cannot("start to first sample", busy)
    else:
        bars.most("start to first sample", begun_s, START_BAR_S, "s")
    return bars.end()


if __name__ == "__main__":
    sys.exit(main())
