"""Random kills and stops of core, gateway, both, client and `safe` while a trajectory runs.

A kill is SIGKILL; a stop is SIGSTOP for 0.2 to 5 s, then SIGCONT. The recovery time is measured
from the kill, or from the end of the stop, until fresh samples of the trajectory reach a client
again. Last, the dead man's path is timed: supervisor and core are killed at once while the output
is high. The amplifier's own log is the evidence for the output, the process table for orphans.

example: python -m tests.benchmarks.daemon.kills            (100 of them: about 20 minutes)
         python -m tests.benchmarks.daemon.kills --count 6 --seed 3
"""

import argparse
import os
import re
import signal
import subprocess
import sys
import tempfile
import time
from pathlib import Path

import numpy as np
from tests.benchmarks.bars import Bars, too_busy
from tests.rigs.chaos.kills import Account, Kills, processes_of
from tests.rigs.chaos.rig import MAX_V, RATE_HZ, SAFE_V, SLEW, Rig, until
from tests.rigs.output import DAC_STEP_V, excess

from dehyst.daemon.bench.simulated import simulated_model
from dehyst.daemon.files.models import save_model

MOST_RECOVERY_S, MOST_SAFE_S = 12.0, 3.0


def main() -> int:
    """Print what happened, and the bars."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawTextHelpFormatter
    )
    parser.add_argument("--count", type=int, default=100)
    parser.add_argument("--seed", type=int, default=1)
    o = parser.parse_args()
    busy, bars = too_busy(), Bars()
    with tempfile.TemporaryDirectory(prefix="dehyst-kills-") as name:
        folder = Path(name)
        save_model(simulated_model(), folder / "identified.toml")
        rig = Rig(folder, folder / "identified.toml")
        try:
            rig.run()
            account = Kills(rig, o.seed).run(o.count)
            log = rig.output()
            safe_s, volts = dead_man(rig)
        finally:
            rig.close()
        time.sleep(1.0)
        account.orphans |= set(processes_of(rig.config))
        said = {path.name: path.read_text(errors="replace") for path in folder.glob("*.txt")}
    judge(account, o.count, said, log, bars)
    print(f"dead man's path: {volts:.0f} V to {SAFE_V:g} V in {safe_s:.2f} s")
    if busy:
        bars.cannot("dead man's path", busy)
    else:
        bars.most("dead man's path", safe_s, MOST_SAFE_S, "s")
    return bars.end()


def judge(
    account: Account,
    count: int,
    said: dict[str, str],
    log: tuple[np.ndarray, np.ndarray],
    bars: Bars,
) -> None:
    """Print the figures, and the bars."""
    for words in (*account.lost, *account.unreadable):
        print(words)
    times = np.array([seconds for _, _, seconds in account.recovery_s] or [np.nan])
    kinds = sorted({(how, who) for who, how, _ in account.recovery_s})
    for how, who in kinds:
        some = [s for w, h, s in account.recovery_s if (h, w) == (how, who)]
        print(f"{how} {who:8s} {len(some):3d} times, median {np.median(some):5.2f} s, "
              f"longest {max(some):5.2f} s")  # fmt: skip
    median, p99 = np.percentile(times, (50, 99))
    print(f"recovery: median {median:.2f} s, p99 {p99:.2f} s, longest {times.max():.2f} s; "
          f"{len(account.rows)} recordings, {sum(account.rows)} rows")  # fmt: skip
    bars.least("recovered", len(account.recovery_s), count)
    bars.most("recovery, p99", p99, MOST_RECOVERY_S, "s")
    bars.none("false hangs", len(re.findall("hangs; killing it", said["run.txt"])))
    bars.none("orphans", len(account.orphans))
    bars.none("recordings that cannot be read", len(account.unreadable))
    bars.none("tracebacks", sum(text.count("Traceback") for text in said.values()))
    judge_output(log, bars)


def judge_output(log: tuple[np.ndarray, np.ndarray], bars: Bars) -> None:
    """Judge range and slew over every window of the amplifier's own log."""
    _, volts = log
    bars.least("lowest output", float(volts.min()), 0.0, "V")
    bars.most("highest output", float(volts.max()), MAX_V + DAC_STEP_V, "V")
    beyond, i, j = excess(*log, SLEW)
    print(f"output: {volts.size} writes; most beyond slew x time {beyond:.3f} V, in a window of "
          f"{j - i + 1} writes")  # fmt: skip
    bars.most("beyond slew x time, any window", beyond, SLEW / RATE_HZ + DAC_STEP_V, "V")


def dead_man(rig: Rig) -> tuple[float, float]:
    """Return (seconds, volts before) of the unit's ExecStopPost= command, run cold, after
    supervisor and core were killed at once while the output was high."""
    assert rig.mover is not None
    rig.mover.kill()
    rig.mover.wait(5.0)
    rig.client.take_over()
    target = 0.95 * rig.status().reach_max
    end = time.monotonic() + 60.0
    while rig.bench_order()["output_v"] < 115.0 and time.monotonic() < end:
        rig.client.send(target)
        time.sleep(0.1)
    core = rig.pid("core")
    for pid in (rig.daemon.pid, core):
        os.kill(pid, signal.SIGKILL)
    rig.daemon.wait(5.0)
    until(lambda: core not in processes_of(rig.config), 10.0, "the core is gone")
    volts = float(rig.bench_order()["output_v"])
    begun = time.monotonic()
    subprocess.run(
        [sys.executable, "-B", "-X", "pycache_prefix=/nonexistent", "-m", "dehyst.daemon.main",
         "safe", "--config", str(rig.config)],
        env=rig.environment, check=True, timeout=60.0,
    )  # fmt: skip
    seconds = time.monotonic() - begun
    left = float(rig.bench_order()["output_v"])
    assert abs(left - SAFE_V) < 0.02, f"{left} V are left"
    return seconds, volts


if __name__ == "__main__":
    sys.exit(main())
