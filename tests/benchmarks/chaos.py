"""The chaos test with its full times, as a table: what was done, what happened, how long it took.

example: python -m tests.benchmarks.chaos            (all of it: about three minutes)
         python -m tests.benchmarks.chaos kill_core unplug
"""

import sys
import tempfile
import time
from collections.abc import Callable
from pathlib import Path

from tests.daemon import chaos_commands, chaos_pairs
from tests.daemon import chaos_faults as faults
from tests.daemon.chaos_rig import SLEW, Rig

from dehyst.daemon.benchconfig import simulated_model
from dehyst.daemon.files import save_model

RAMP = (
    *faults.PROCESSES,
    *faults.DEVICES,
    *faults.HOST,
    *chaos_commands.COMMANDS,
    *chaos_pairs.PAIRS,
)
HOLD = (faults.kill_core_hold, faults.unplug_hold)


def series(chosen: tuple[Callable[..., str], ...], on_fault: str, model: Path) -> int:
    """Do these faults to one daemon; how many failed."""
    failed = 0
    with tempfile.TemporaryDirectory(prefix="dehyst-chaos-") as folder:
        rig = Rig(Path(folder), model, on_fault)
        try:
            begun = time.monotonic()
            rig.run()
            print(f"| (start to the first controlled sample of the trajectory) | | | | "
                  f"{time.monotonic() - begun:.1f} s |", flush=True)  # fmt: skip
            recording = Path(folder) / "whole.csv"
            rig.record(recording)
            for fault in chosen:
                if reason := faults.why_not(fault):
                    print(f"| {fault.__doc__} | skipped: {reason} | | | |")
                    continue
                try:
                    o = faults.inflict(rig, fault, recording)
                except AssertionError as error:
                    failed += 1
                    print(f"| {fault.__doc__} | **failed: {str(error)[:200]}** | | | |", flush=True)
                    rig.bench_order(clear=True)
                    continue
                end = rig.status().state
                print(
                    f"| {o.fault} | {o.happened} | {o.slew:.0f} of {SLEW:.0f} V/s | {end} | "
                    f"{o.seconds:.1f} s |",
                    flush=True,
                )
        finally:
            rig.close()
    return failed


def main(names: list[str]) -> int:
    """Both settings of safe.on_fault; the number of failures."""
    print("| fault | what happened | fastest output, range kept | end | trajectory again after |")
    print("|---|---|---|---|---|")
    failed = 0
    with tempfile.TemporaryDirectory(prefix="dehyst-chaos-") as folder:
        model = Path(folder) / "model.toml"
        save_model(simulated_model(), model)
        for group, on_fault in ((RAMP, "ramp"), (HOLD, "hold")):
            chosen = tuple(f for f in group if not names or f.__name__ in names)
            if chosen:
                failed += series(chosen, on_fault, model)
    return failed


if __name__ == "__main__":
    sys.exit(min(1, main(sys.argv[1:])))
