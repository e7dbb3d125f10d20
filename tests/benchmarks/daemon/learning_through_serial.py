"""Learning by `dehyst play` from another process, through the emulated MDT693B at 200 Hz.

    python -m tests.benchmarks.daemon.learning_through_serial [--passes N]

The error is the true displacement's: the emulated amplifier's own log of its output drives a
second simulated stage, which is asked where it was at each deadline.
Passes in which the loop missed a deadline are learned from by nobody, and not judged.
"""

import argparse
import os
import subprocess
import sys
import tempfile
from pathlib import Path

import numpy as np
from tests.benchmarks.bars import Bars, too_busy
from tests.rigs.gateway_bench import free_port
from tests.rigs.processes import EmulatedBench, dehyst, until

from dehyst.daemon.bus.session import BusError
from dehyst.daemon.client.client import Client
from dehyst.daemon.files.recordings import write_recording
from dehyst.daemon.rings.records import Flag
from dehyst.daemon.tools.bench_config import RATE_HZ, simulated_model, write_bench
from dehyst.drivers.simulated.stage import Stage
from dehyst.models.model import Floats

SINES = ((1.0, 8.0), (5.0, 6.0))
LEAST_GAIN = 5.0


def true_at(bench: EmulatedBench, moments_ns: np.ndarray) -> Floats:
    """(n,) where the stage was at these times [um]."""
    log_ns, volts = bench.output()
    every, where = np.unique(np.concatenate([log_ns, moments_ns]), return_inverse=True)
    held = volts[np.clip(np.searchsorted(log_ns, every, side="right") - 1, 0, None)]
    true, _ = Stage().run((every - every[0]) * 1e-9, held)
    return np.asarray(true[where[log_ns.size :]])


def passes_of(client: Client, bench: EmulatedBench, passes: int, n: int) -> Floats:
    """(passes,) std of the true error of each [nm]; NaN where a deadline was missed."""
    records = client.history(seconds=passes * n / RATE_HZ + 5.0)
    begun = int(np.flatnonzero(records["flags"] & int(Flag.APPROACH))[-1]) + 1
    records = records[begun : begun + passes * n]
    error = 1e3 * (true_at(bench, records["scheduled_ns"]) - records["target"])
    late = (records["flags"] & int(Flag.MISSED)) != 0
    each = zip(np.array_split(error, passes), np.array_split(late, passes), strict=True)
    return np.array([np.nan if missed.any() else part.std() for part, missed in each])


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0] if __doc__ else "")
    parser.add_argument("--passes", type=int, default=24)
    args = parser.parse_args()
    bars, busy = Bars(), too_busy(1.0)
    with tempfile.TemporaryDirectory() as name:
        folder, address = Path(name), f"tcp/127.0.0.1:{free_port()}"
        bench = EmulatedBench(folder)
        config = write_bench(folder, bench.ports, "serial", address, simulated_model())
        daemon = dehyst("run", "--config", str(config), stdout=None, stderr=subprocess.DEVNULL)
        try:
            client = until(lambda: connected(address), 240.0, "the daemon")
            for hertz, um in SINES:
                t_s = np.arange(round(RATE_HZ)) / RATE_HZ
                target = 8.0 - 0.5 * um * np.cos(2.0 * np.pi * hertz * t_s)
                path = folder / f"sine-{hertz:g}.csv"
                write_recording(path, t_s, {"target_um": target})
                subprocess.run(
                    [
                        sys.executable, "-m", "dehyst.daemon.main", "play", str(path), "--learn",
                        "--repeat", str(args.passes), "--connect", address, "--picture",
                        str(folder / f"{hertz:g}.png"),
                    ],
                    check=False, env=os.environ, timeout=300,
                )  # fmt: skip
                std = passes_of(client, bench, args.passes, t_s.size)
                print(f"{um:g} um at {hertz:g} Hz:", " ".join(f"{s:.1f}" for s in std), "nm")
                first, last = std[:3][np.isfinite(std[:3])], std[12:][np.isfinite(std[12:])]
                gain = float(first[0] / np.median(last)) if first.size and last.size else np.nan
                if busy and not gain >= LEAST_GAIN:
                    bars.cannot(f"{hertz:g} Hz, first pass over the last ones: {gain:.1f}", busy)
                else:
                    bars.least(f"{hertz:g} Hz, first pass over the last ones", gain, LEAST_GAIN)
            client.close()
        finally:
            daemon.terminate()
            daemon.wait(60)
            bench.close()
    return bars.end()


def connected(address: str) -> Client | None:
    """A client of a loop that runs."""
    try:
        client = Client(connect=address)
    except BusError:
        return None
    if client.status().state == "ready":
        return client
    client.close()
    return None


if __name__ == "__main__":
    sys.exit(main())
