"""The chaos test with its full times, as a table: the fault, the reaction, and its duration.

example: python -m tests.benchmarks.daemon.chaos            (all of it: about three minutes)
         python -m tests.benchmarks.daemon.chaos kill_core unplug
         python -m tests.benchmarks.daemon.chaos --axes 3
         python -m tests.benchmarks.daemon.chaos --units     (the other serial amplifiers)

With --axes 3, the faults hit axis x of three axes, and faults that only several axes can have are
added: y plays its own trajectory, z holds its position, and the amplifier's log of every channel is
judged.
"""

import argparse
import sys
import tempfile
import time
from collections.abc import Callable, Sequence
from pathlib import Path

from tests.benchmarks.bars import Bars
from tests.rigs.chaos import axes, faults
from tests.rigs.chaos import commands as chaos_commands
from tests.rigs.chaos import pairs as chaos_pairs
from tests.rigs.chaos import units as chaos_units
from tests.rigs.chaos.axes_rig import AxesRig
from tests.rigs.chaos.rig import RATE_HZ, SLEW, Rig

from dehyst.daemon.bench.simulated import simulated_model
from dehyst.daemon.files.models import save_model
from dehyst.drivers.simulated.axes import settings_by_axis

RAMP = (
    *faults.PROCESSES,
    *faults.DEVICES,
    *faults.HOST,
    *chaos_commands.COMMANDS,
    *chaos_pairs.PAIRS,
)
HOLD = (faults.kill_core_hold, faults.unplug_hold)


def series(chosen: Sequence[Callable[..., str]], make: Callable[[Path], Rig], bars: Bars) -> None:
    """Apply these faults to one running daemon, and to a new one after each that failed."""
    left = list(chosen)
    while left:
        with tempfile.TemporaryDirectory(prefix="dehyst-chaos-") as folder:
            rig = make(Path(folder))
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
    """Apply one fault and print its row; return whether the rig can be used for another."""
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


def main() -> int:
    """Run both settings of safe.on_fault; return the exit status."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawTextHelpFormatter
    )
    parser.add_argument("names", nargs="*", metavar="FAULT", help="these only")
    parser.add_argument("--axes", type=int, choices=(1, 3), default=1)
    parser.add_argument("--units", action="store_true", help="with each other serial amplifier")
    args = parser.parse_args()
    bars = Bars()
    print("| fault | what happened | movement beyond slew x time, of a step | end | "
          "trajectory again after |")  # fmt: skip
    print("|---|---|---|---|---|")
    with tempfile.TemporaryDirectory(prefix="dehyst-chaos-") as folder:
        models = {axis: Path(folder) / f"model-{axis}.toml" for axis in "xyz"[: args.axes]}
        for axis, stage in settings_by_axis(list(models), {}).items():
            save_model(simulated_model(stage), models[axis])
        if args.units:
            for unit in chaos_units.UNITS:
                print(f"| **{unit}** | | | | |")
                gauge = chaos_units.GAUGE_FAULTS if unit == "kpz101" else ()
                series(
                    _wanted((*chaos_units.FAULTS, *gauge), args.names),
                    lambda place, unit=unit: chaos_units.UnitRig(place, models["x"], unit),
                    bars,
                )
            return bars.end()
        more = axes.AXES if args.axes > 1 else ()
        for group, on_fault in (((*more, *RAMP), "ramp"), (HOLD, "hold")):
            series(
                _wanted(group, args.names),
                lambda place, on_fault=on_fault: (
                    Rig(place, models["x"], on_fault)
                    if args.axes == 1
                    else AxesRig(place, models, on_fault)
                ),
                bars,
            )
    return bars.end()


def _wanted(
    faults_of: Sequence[Callable[..., str]], names: list[str]
) -> Sequence[Callable[..., str]]:
    return tuple(f for f in faults_of if not names or f.__name__ in names)


if __name__ == "__main__":
    sys.exit(main())
