"""A daemon's session on a machine so busy that zenoh's threads hardly run.

    python -m tests.rigs.starved_sender ADDRESS KEY PAIRS

It serves at the address, prints `ready`, and publishes a status and an event at KEY/status and
KEY/event now and then, until it gets a line. Then it publishes both PAIRS times without a pause,
each with its number. Meanwhile it has one processor, which another process keeps busy, and its
threads but this one run only when nothing else wants to (SCHED_IDLE). Afterwards they run as usual,
until the input ends.
"""

import os
import select
import subprocess
import sys
import threading
from collections.abc import Iterator
from contextlib import contextmanager

from dehyst.daemon.bus.session import Bus
from dehyst.daemon.bus.topics import EVENT, STATUS

STATUS_BYTES, EVENT_BYTES = 900, 200  # about what they are in the daemon
NO_NUMBER = b""


def main(address: str, key: str, pairs: int) -> None:
    """Serve until the input ends."""
    os.sched_setaffinity(0, {min(os.sched_getaffinity(0))})
    bus = Bus.serve([address], [])
    status, event = bus.sender(f"{key}/status", STATUS), bus.sender(f"{key}/event", EVENT)
    print("ready", flush=True)
    while not select.select([sys.stdin], [], [], 0.02)[0]:
        status.put(NO_NUMBER)
        event.put(NO_NUMBER)
    sys.stdin.readline()
    with _starved():
        for number in range(pairs):
            status.put(number.to_bytes(4, "big").rjust(STATUS_BYTES))
            event.put(number.to_bytes(4, "big").rjust(EVENT_BYTES))
    sys.stdin.read()
    bus.close()


@contextmanager
def _starved() -> Iterator[None]:
    others = [int(name) for name in os.listdir("/proc/self/task")]
    others.remove(threading.get_native_id())
    for thread in others:
        os.sched_setscheduler(thread, os.SCHED_IDLE, os.sched_param(0))
    with subprocess.Popen([sys.executable, "-c", "while True: pass"]) as busy:
        try:
            yield
        finally:
            busy.kill()
            for thread in others:
                os.sched_setscheduler(thread, os.SCHED_OTHER, os.sched_param(0))


if __name__ == "__main__":
    main(sys.argv[1], sys.argv[2], int(sys.argv[3]))
