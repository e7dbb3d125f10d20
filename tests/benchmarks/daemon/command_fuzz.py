"""Command fuzzing with device faults, kills and reloads, judged by the amplifier's own log.

Two clients send valid, wrong and damaged commands to a real daemon on the emulated bench while
devices fail, processes are stopped and killed, and the model file is replaced. Range and slew (over
every window of any length) are read from the emulator's log of its output.

example: python -m tests.benchmarks.daemon.command_fuzz --for 3600
         python -m tests.benchmarks.daemon.command_fuzz --for 60 --seed 7
         python -m tests.benchmarks.daemon.command_fuzz --for 600 --axes 3

With --axes 3, two clients do this to axis x and two to axis y of one amplifier; no client commands
z, whose output must not move at all.
"""

import argparse
import re
import sys
import tempfile
from pathlib import Path

import numpy as np
from tests.benchmarks.bars import Bars
from tests.benchmarks.daemon.kills import judge_output
from tests.rigs.chaos.axes_rig import RESTING, AxesRig
from tests.rigs.chaos.fuzzing import Fuzz
from tests.rigs.chaos.rig import Rig, until

from dehyst.daemon.bench.simulated import simulated_model
from dehyst.daemon.client.client import Client
from dehyst.daemon.files.models import save_model
from dehyst.drivers.simulated.axes import settings_by_axis
from dehyst.models.errors import DehystError

ERRORS = ("BusError", "NoAnswer", "Nobody", "Refusal", "BadMessage")
"""Errors that a client gets while the daemon is away; all other counts are of commands."""


def main() -> int:
    """Print actions, answers and the bars."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawTextHelpFormatter
    )
    parser.add_argument("--for", dest="seconds", type=float, default=3600.0)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--axes", type=int, choices=(1, 3), default=1)
    parser.add_argument("--keep", type=Path, metavar="DIR", help="log and words go there")
    o = parser.parse_args()
    bars = Bars()
    with tempfile.TemporaryDirectory(prefix="dehyst-command-fuzz-") as name:
        folder = Path(name)
        rig = rig_of(folder, o.axes)
        try:
            rig.run()
            rig.kill("client")
            if isinstance(rig, AxesRig):
                rig.end_beside()
            counts = Fuzz(rig, o.seed).run(o.seconds)
            follows = follows_again(rig)
            logs = {"x": rig.output()}
            if isinstance(rig, AxesRig):
                logs = {axis: rig.channel(axis) for axis in "xyz"}
        finally:
            rig.close()
        said = {path.name: path.read_text(errors="replace") for path in folder.glob("*.txt")}
    print(", ".join(f"{what} {count}" for what, count in counts.most_common()))
    run = said["run.txt"]
    if o.keep is not None:
        o.keep.mkdir(parents=True, exist_ok=True)
        for axis, (time_ns, volts) in logs.items():
            np.savez(o.keep / f"output-{axis}.npz", time_ns=time_ns, volts=volts)
        for file, text in said.items():
            (o.keep / file).write_text(text)
    bars.least("operations", counts.total() - sum(counts[e] for e in ERRORS), 1)
    for axis in "xy"[: o.axes]:
        judge_output(logs[axis], bars)
    if isinstance(rig, AxesRig):
        bars.none("moves of z", int(np.count_nonzero(logs[RESTING][0] > rig.rested_ns)))
    bars.none("tracebacks", sum(text.count("Traceback") for text in said.values()))
    bars.none("processes that crashed", len(re.findall(r"ended with code (?!-9|2;|2:)", run)))
    bars.none("false hangs", run.count("hangs; killing it"))
    bars.add("a set-point at the end", "followed" if follows else "not followed", "followed",
             follows)  # fmt: skip
    return bars.end()


def rig_of(folder: Path, axes: int) -> Rig:
    """Make bench and daemon with models of the unchanged stage."""
    models = {axis: folder / f"identified-{axis}.toml" for axis in "xyz"[:axes]}
    for axis, stage in settings_by_axis(list(models), {}).items():
        save_model(simulated_model(stage), models[axis])
    return AxesRig(folder, models) if axes > 1 else Rig(folder, models["x"])


def follows_again(rig: Rig) -> bool:
    """Check that a client can command as usual after all of this."""

    def sent() -> bool:
        try:
            with Client(rig.name, rig.address, label="afterwards") as client:
                client.take_over()
                status = client.status()
                middle = 0.5 * (status.reach_min + status.reach_max)
                client.send(middle)
                until(lambda: abs(rig.target() - middle) < 1e-9, 5.0, "it is followed")
        except (DehystError, AssertionError):
            return False
        return True

    try:
        return bool(until(sent, 60.0, "a set-point is followed"))
    except AssertionError:
        return False


if __name__ == "__main__":
    sys.exit(main())
