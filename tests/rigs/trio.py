"""Several axes in virtual time on one clock, run by either engine; each on a simulated stage of its
own unless a test passes other devices or models."""

from collections.abc import Iterable, Mapping, Sequence

import numpy as np
from tests.rigs.two_loops import PERIOD_NS, Rig, VirtualClock

from dehyst.daemon.loop import records_in_memory
from dehyst.daemon.loop.compiled_loop import CompiledLoop
from dehyst.daemon.loop.python_loop import Axis, PythonLoop, Together
from dehyst.daemon.rings.records import COMMAND, LoopCommand
from dehyst.models.model import Block


def group_points(
    values: Sequence[float],
    group: int = 9,
    members: int = 2,
    first: int = 0,
    last: bool = False,
    trajectory: int = 5,
) -> np.ndarray:
    """Return points of a trajectory of `members` axes together, one a period, from `first` on."""
    batch = np.zeros(len(values), COMMAND)
    batch["kind"], batch["trajectory"] = LoopCommand.POINT, trajectory
    batch["group"], batch["members"] = group, members
    batch["offset_ns"] = (first + np.arange(len(values))) * PERIOD_NS
    batch["value"] = values
    batch["last"][-1:] = last
    return batch


class Trio:
    """Axes x, y, z (or those that are named), each a Rig; `play` runs them together."""

    def __init__(
        self,
        prefix: str,
        axes: str = "xyz",
        mode: str = "static",
        lateness_ns: Iterable[int] = (5000,),
        blocks: Mapping[str, tuple[Block, ...]] | None = None,
        origins: Mapping[str, float] | None = None,
    ) -> None:
        """blocks: of the model of each axis; those whose channel is `axis.y` or `axis.y.drive`
        follow that axis; origins: of each axis, its model's displacement at set-point 0."""
        blocks, origins = blocks or {}, origins or {}
        self.rigs = {
            a: Rig(f"{prefix}-{a}", mode, blocks=blocks.get(a, ()), origin=origins.get(a, 0.0))
            for a in axes
        }
        for rig in self.rigs.values():
            channels = rig.stepper.compensator.channels
            rows = np.zeros(len(channels), records_in_memory.FOLLOW_T)
            for i, name in enumerate(channels):
                other = self.rigs[name.split(".")[1]].stepper.table.address
                rows[i] = (i, other, name.endswith(".drive"), 1.0, 0.0)
            rig.stepper.follow(rows)
        self.clock = VirtualClock(lateness_ns)
        self.words = self.clock.words()
        self.together: list[Together] = []

    def play(
        self, commands: Mapping[str, np.ndarray], samples: int, compiled: bool = False
    ) -> dict[str, np.ndarray]:
        """Push commands to axes, run this many samples; return each axis' telemetry of them."""
        first, *others = [rig.monitor for rig in self.rigs.values()]
        if compiled:
            runner: CompiledLoop | PythonLoop = CompiledLoop(first, beside=others)
            next(iter(self.rigs.values())).stepper.table.put(records_in_memory.CLOCK, self.words)
        else:
            runner = PythonLoop(
                first,
                self.clock.now,
                self.clock.sleep_until,
                beside=[Axis(monitor) for monitor in others],
                together=self.together,
            )
        for axis, batch in commands.items():
            self.rigs[axis].rings["command"].push_many(batch)
        begun = first.samples
        runner.run(begun + samples)
        return {axis: rig.rings["telemetry"].read(begun)[0] for axis, rig in self.rigs.items()}

    def events(self, axis: str) -> list[str]:
        """Return what an axis reported."""
        return [row["text"].decode() for row in self.rigs[axis].rings["event"].read(0)[0]]
