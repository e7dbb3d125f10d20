"""Many controllers and many subscribers through one router: data loss and cost.

tests/rigs/controllers.py documents what runs and what is counted. The age of a sample is measured
from the loop's wake-up to its reception by the subscriber and includes half a batch on average.
Memory is the proportional set size (PSS), which counts shared memory once.

example: python -m tests.benchmarks.daemon.scale --daemons 20 --subscribers 50 --for 60
"""

import argparse
import os
import signal
import sys

from tests.benchmarks.bars import Bars
from tests.rigs.controllers import run


def main() -> int:
    """Print the table and the bars."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawTextHelpFormatter
    )
    parser.add_argument("--daemons", type=int, default=20)
    parser.add_argument("--subscribers", type=int, default=50)
    parser.add_argument("--for", dest="seconds", type=float, default=60.0)
    parser.add_argument("--rate", type=float, default=50.0, help="of each loop [Hz]")
    parser.add_argument("--batch", type=float, default=0.05, help="telemetry.batch_s")
    o = parser.parse_args()
    signal.signal(signal.SIGTERM, lambda *_: sys.exit("ended before its time"))
    bars = Bars()
    try:
        r = run(o.daemons, o.subscribers, o.seconds, o.rate, o.batch)
    except TimeoutError as error:
        bars.cannot("nothing is lost", str(error))
        return bars.end()
    load = os.getloadavg()[0]
    print(
        f"{o.daemons} controllers at {o.rate:g} Hz, batches of {o.batch:g} s, {o.subscribers} "
        f"subscribers, {r.seconds:.0f} s (all up after {r.start_s:.0f} s, load average {load:.1f})"
    )
    print(
        f"telemetry   {r.samples} samples due at the subscribers, {r.lost} lost, {r.overwritten} "
        f"overwritten before a gateway read them, {r.bad} messages not readable"
    )
    print(f"status and events {r.reported} due, {r.untold} missed")
    print(f"set-points  {r.put} put, {r.asked} asked, {r.lost_commands} did not arrive, "
          f"{r.unanswered} without an answer")  # fmt: skip
    print(
        "age of a sample p50 / p99 / longest: " + " / ".join(f"{a:.1f}" for a in r.age_ms) + " ms"
    )
    print(f"missed deadlines of all loops since their start: {r.missed}")
    print("part          CPU, one core = 100 %   memory (PSS)")
    for name in r.cpu:
        print(f"{name:12s} {100 * r.cpu[name]:12.1f} % {r.memory[name]:18.0f} MB")
    whole = sum(r.cpu.values())
    print(f"{'all':12s} {100 * whole:12.1f} % {sum(r.memory.values()):18.0f} MB")
    bars.least("samples due", r.samples, 1)
    for name, count in (
        ("samples lost", r.lost), ("samples overwritten unread", r.overwritten),
        ("statuses and events missed", r.untold), ("set-points that did not arrive",
        r.lost_commands), ("questions without an answer", r.unanswered),
        ("unreadable messages", r.bad),
    ):  # fmt: skip
        bars.none(name, count)
    return bars.end()


if __name__ == "__main__":
    sys.exit(main())
