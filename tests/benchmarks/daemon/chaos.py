"""The chaos test with its full times, as a table: what was done, what happened, how long it took.

example: python -m tests.benchmarks.daemon.chaos            (all of it: about three minutes)
         python -m tests.benchmarks.daemon.chaos kill_core unplug
"""

import sys
import tempfile
import time
from collections.abc import Callable
from pathlib import Path

from tests.benchmarks.bars import Bars
from tests.rigs.chaos import commands as chaos_commands
from tests.rigs.chaos import faults
from tests.rigs.chaos import pairs as chaos_pairs
from tests.rigs.chaos.rig import RATE_HZ, SLEW, Rig

from dehyst.daemon.files.models import save_model
from dehyst.daemon.tools.bench_config import simulated_model

RAMP = (
    *faults.PROCESSES,
    *faults.DEVICES,
    *faults.HOST,
    *chaos_commands.COMMANDS,
    *chaos_pairs.PAIRS,
)
HOLD = (faults.kill_core_hold, faults.unplug_hold)


def series(chosen: tuple[Callable[..., str], ...], on_fault: str, model: Path, bars: Bars) -> None:
    """Do these faults to one daemon; to another one behind a fault that failed."""
    left = list(chosen)
    while left:
        with tempfile.TemporaryDirectory(prefix="dehyst-chaos-") as folder:
            rig = Rig(Path(folder), model, on_fault)
            try:
                begun = time.monotonic()
                rig.run()
                print(f"| (start to the first controlled sample of the trajectory) | | | | "
                      f"{time.monotonic() - begun:.1f} s |", flush=True)  # fmt: skip
                recording = Path(folder) / "whole.csv"
                rig.record(recording)
                while left and one(rig, recording, left.pop(0), bars):
                    pass
            finally:
                rig.close()


def one(rig: Rig, recording: Path, fault: Callable[..., str], bars: Bars) -> bool:
    """Do one fault and print its row; whether the rig is fit for another."""
    if reason := faults.why_not(fault):
        print(f"| {fault.__doc__} | skipped: {reason} | | | |")
        bars.cannot(fault.__name__, reason)
        return True
    try:
        o = faults.inflict(rig, recording, fault)
    except AssertionError as error:
        said = " ".join(str(error).split())[:200]
        print(f"| {fault.__doc__} | **failed: {said}** | | | |", flush=True)
        bars.add(fault.__name__, said, "what it says", False)
        return False
    state = rig.status().state
    print(
        f"| {o.fault} | {o.happened} | {o.beyond_v:.1f} of {SLEW / RATE_HZ:.1f} V | {state} | "
        f"{o.seconds:.1f} s |",
        flush=True,
    )
    bars.add(fault.__name__, o.happened, "what it says", True)
    return True


def main(names: list[str]) -> int:
    """Both settings of safe.on_fault; the exit status."""
    bars = Bars()
    print("| fault | what happened | movement beyond slew x time, of a step | end | "
          "trajectory again after |")  # fmt: skip
    print("|---|---|---|---|---|")
    with tempfile.TemporaryDirectory(prefix="dehyst-chaos-") as folder:
        model = Path(folder) / "model.toml"
        save_model(simulated_model(), model)
        for group, on_fault in ((RAMP, "ramp"), (HOLD, "hold")):
            chosen = tuple(f for f in group if not names or f.__name__ in names)
            series(chosen, on_fault, model, bars)
    return bars.end()


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
