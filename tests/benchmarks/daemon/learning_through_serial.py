"""Learning by `dehyst play` from another process, through the emulated MDT693B at 200 Hz.

    python -m tests.benchmarks.daemon.learning_through_serial [--passes N]

The error is that of the true displacement, by the bench's own clock, at the moment at which the
gauge was read, which is the moment that the loop compares with the target and learns from. The
emulated gauge logs where the stage was. At the deadline, 0.4 ms earlier, the stage is elsewhere:
each step of the output makes it ring at 780 Hz. Its position there is printed too: a second
simulated stage follows the amplifier's log of its output. Passes in which the loop missed a
deadline are not learned from and not judged. Each sine is learned twice: without, and with the
gauge's filter declared (`--gauge-filter-s`), which is judged.

If the machine takes time from the loop, most passes miss a deadline. A witness that runs at the
same time distinguishes this from a loop that is late by itself (tests/benchmarks/late_wakeups.py),
and the load before the run shows whether others use the machine. Exit status: see
tests/benchmarks/bars.py.
"""

import argparse
import math
import os
import subprocess
import sys
import tempfile
from itertools import product
from pathlib import Path
from typing import NamedTuple

import numpy as np
from tests.benchmarks.bars import Bars, too_busy
from tests.benchmarks.late_wakeups import LateWakeups, was_away
from tests.rigs.gateway_bench import free_port
from tests.rigs.processes import EmulatedBench, dehyst, until

from dehyst.daemon.bench.simulated import RATE_HZ, simulated_model, write_bench
from dehyst.daemon.bus.session import BusError
from dehyst.daemon.client.client import Client
from dehyst.daemon.files.recordings import write_recording
from dehyst.daemon.rings.records import Flag
from dehyst.drivers.simulated.stage import SimulatedStage
from dehyst.models.model import Floats

SINES = ((1.0, 8.0), (5.0, 6.0))
FILTERS_S = (0.0, 150e-6)  # not declared, and as the simulated gauge has it
LEAST_GAIN = 5.0
BEFORE_S = 60.0  # the longest time since the approach, on a busy machine


class Errors(NamedTuple):
    """(passes, n) each [nm], NaN if a pass missed a deadline or a sample had no reading: errors of
    the true displacement when the gauge was read, of the reading, and of the true one at the
    deadline."""

    true: Floats
    reading: Floats
    at_deadline: Floats


def true_at(logged: dict[str, np.ndarray], moments_ns: np.ndarray) -> Floats:
    """Return (n,) the true displacement at these times [um]."""
    log_ns, volts = logged["time_ns"], logged["volts"]
    every, where = np.unique(np.concatenate([log_ns, moments_ns]), return_inverse=True)
    held = volts[np.clip(np.searchsorted(log_ns, every, side="right") - 1, 0, None)]
    true, _ = SimulatedStage().run((every - every[0]) * 1e-9, held)
    return np.asarray(true[where[log_ns.size :]])


def errors_of(client: Client, bench: EmulatedBench, passes: int, n: int) -> Errors:
    """Return the errors that bench and loop logged in the newest passes."""
    records = client.history(seconds=passes * n / RATE_HZ + BEFORE_S)
    begun = int(np.flatnonzero(records["flags"] & int(Flag.APPROACH))[-1]) + 1
    records = records[begun : begun + passes * n]
    logged, due_ns = bench.logged(), records["scheduled_ns"]
    place = np.searchsorted(logged["reading_ns"], due_ns)
    place = np.minimum(place, logged["reading_ns"].size - 1)
    waited_s = (logged["reading_ns"][place] - due_ns) * 1e-9
    true = np.where(waited_s < 1.0 / RATE_HZ, logged["true_um"][place], np.nan)
    late = ((records["flags"] & int(Flag.MISSED)) != 0).reshape(passes, n).any(axis=1)
    every = []
    for displacement in (true, records["measured"], true_at(logged, due_ns)):
        error = 1e3 * (displacement - records["target"]).reshape(passes, n)
        every.append(np.where(late[:, None], np.nan, error))
    return Errors(*every)


def scatter(error: Floats) -> Floats:
    """Return (passes,) the std of each; NaN if a pass is not judged."""
    judged = np.isfinite(error).any(axis=1)
    out = np.full(judged.size, np.nan)
    out[judged] = np.nanstd(error[judged], axis=1)
    return out


def gain_of(error: Floats) -> float:
    """Return the std of the first pass divided by that of the last ones."""
    std = scatter(error)
    first, last = std[:3][np.isfinite(std[:3])], std[12:][np.isfinite(std[12:])]
    return float(first[0] / np.median(last)) if first.size and last.size else np.nan


def tell(errors: Errors) -> None:
    """Print the passes, and the error common to all of the last ones."""
    words = ("true when the gauge is read", "reading, with its noise", "true at the deadline")
    for what, error in zip(words, errors, strict=True):
        std, last = scatter(error), error[12:][np.isfinite(error[12:]).any(axis=1)]
        each = " ".join(f"{s:.0f}" for s in std)
        repeats = float(np.nanstd(np.nanmean(last, axis=0))) if last.size else np.nan
        print(f"  {what}: {each} nm; {repeats:.1f} of the last ones repeats")


def judge(bars: Bars, name: str, gain: float, share: float, busy: str) -> None:
    """Judge the bar of one sine. gain: NaN if no first or no last pass met all its deadlines;
    share: of the witness' wake-ups that were late, NaN without a witness; busy: why the load before
    the run prevents judging: the kernel carries a pseudo terminal's bytes at no high priority."""
    why = busy or was_away(share)
    if why and not gain >= LEAST_GAIN:
        passes = "no pass to judge" if math.isnan(gain) else f"{gain:.1f}"
        bars.cannot(f"{name}: {passes}", why)
    else:
        bars.least(name, gain, LEAST_GAIN)


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
            try:
                client = until(lambda: connected(address), 240.0, "the daemon")
            except AssertionError as error:
                if not busy:
                    raise
                bars.cannot(f"the daemon is ready {error}", busy)
                return bars.end()
            for (hertz, um), filter_s in product(SINES, FILTERS_S):
                t_s = np.arange(round(RATE_HZ)) / RATE_HZ
                target = 8.0 - 0.5 * um * np.cos(2.0 * np.pi * hertz * t_s)
                path = folder / f"sine-{hertz:g}.csv"
                write_recording(path, t_s, {"target_um": target})
                play = [
                    sys.executable, "-m", "dehyst.daemon.main", "play", str(path), "--learn",
                    "--repeat", str(args.passes), "--connect", address, "--picture",
                    str(folder / f"{hertz:g}-{filter_s:g}.png"),
                    "--gauge-filter-s", str(filter_s),
                ]  # fmt: skip
                with LateWakeups() as witness:
                    subprocess.run(play, check=False, env=os.environ, timeout=300)
                    share = witness.share
                errors = errors_of(client, bench, args.passes, t_s.size)
                print(f"{um:g} um at {hertz:g} Hz, filter declared: {1e6 * filter_s:g} us")
                tell(errors)
                judged = int(np.isfinite(scatter(errors.true)).sum())
                late = witness.refused or f"witness late in {100 * share:.2g} % of its periods"
                gain = gain_of(errors.true)
                print(f"  {judged} of {args.passes} passes had all their deadlines; {late}")
                print(f"  first pass over the last ones: {gain:.1f}")
                if filter_s:
                    judge(bars, f"{hertz:g} Hz, first pass over the last ones", gain, share, busy)
            client.close()
        finally:
            daemon.terminate()
            daemon.wait(60)
            bench.close()
    return bars.end()


def connected(address: str) -> Client | None:
    """Return a client of a running loop."""
    try:
        client = Client(connect=address)
    except BusError:
        return None
    try:
        if client.status().state == "ready":
            return client
    except BusError:  # started, but not answering yet
        pass
    client.close()
    return None


if __name__ == "__main__":
    sys.exit(main())
