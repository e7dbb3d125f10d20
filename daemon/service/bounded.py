"""What a child process gives itself before it computes: lowest priority, bounded memory."""

import os

from dehyst.daemon.loop.timing import realtime
from dehyst.drivers import system


def take_bounds(memory_bytes: int) -> None:
    """Idle priority, so much address space, no core dump; dies with its parent."""
    os.environ["DEHYST_SUPERVISED"] = "1"
    realtime.die_with_parent(system.kill_signal())
    system.lowest_priority()
    system.bound_memory(memory_bytes, core_dump=False)
