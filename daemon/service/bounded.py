"""Limit a child process before it computes: lowest priority, bounded memory."""

import os

from dehyst.daemon.loop.timing import realtime
from dehyst.drivers import system


def take_bounds(memory_bytes: int) -> None:
    """Run at idle priority, with this much address space and no core dump; die with the parent."""
    os.environ["DEHYST_SUPERVISED"] = "1"
    realtime.die_with_parent(system.kill_signal())
    system.lowest_priority()
    system.bound_memory(memory_bytes, core_dump=False)
