"""What a child process gives itself before it computes: lowest priority, bounded memory."""

import os
import resource
import signal
from contextlib import suppress

from dehyst.daemon.loop.timing import realtime


def take_bounds(memory_bytes: int) -> None:
    """Idle priority, so much address space, no core dump; dies with its parent."""
    os.environ["DEHYST_SUPERVISED"] = "1"
    realtime.die_with_parent(signal.SIGKILL)
    os.nice(19)
    with suppress(OSError, AttributeError):  # runs only where no other process wants to
        os.sched_setscheduler(0, os.SCHED_IDLE, os.sched_param(0))
    resource.setrlimit(resource.RLIMIT_AS, (memory_bytes, memory_bytes))
    resource.setrlimit(resource.RLIMIT_CORE, (0, 0))
