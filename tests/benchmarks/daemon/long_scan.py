"""One uninterrupted `dehyst play` while six models change, a gateway is killed and a core is
reloaded: real processes, the emulated MDT693B, real zenoh on loopback.

    python -m tests.benchmarks.daemon.long_scan                 (an hour)
    python -m tests.benchmarks.daemon.long_scan --minutes 5

Required: the play ends, each of its samples was played or is counted as a missed deadline of this
machine, and no window of the amplifier's own log exceeds slew x time plus one step. It prints what
was flagged between changes. The exit status of the play itself is 1, because the shorter reach
leaves points out of reach.
"""

import argparse
import sys
import tempfile
from pathlib import Path

from tests.benchmarks.bars import Bars, too_busy
from tests.rigs.chaos.rig import RATE_HZ, SLEW
from tests.rigs.long_scan import LongScan, scaled
from tests.rigs.output import DAC_STEP_V

STOOD = "the loop paused"
LEAST_MINUTES = 5.0
"""Each change needs half a minute to finish."""


def main() -> int:
    """Print the changes, the flags and the bars."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawTextHelpFormatter
    )
    parser.add_argument("--minutes", type=float, default=60.0)
    seconds = 60.0 * max(LEAST_MINUTES, parser.parse_args().minutes)
    bars = Bars()
    with tempfile.TemporaryDirectory(prefix="dehyst-scan-") as name:
        rig = LongScan(Path(name), seconds)
        try:
            rig.begin()
            change(rig)
            ended = rig.end()
            beyond = rig.beyond_slew_v()
            table = rig.flagged()
            words = (rig.folder / "play.txt").read_text()
        finally:
            rig.close()
    print("\n".join(["", *table]))
    print(f"\nplay: {ended}\n{words[-1500:]}")
    busy = too_busy() if STOOD in str(ended["reason"]) else ""
    if busy:  # other processes delayed the emulated amplifier
        bars.cannot("the play to its end", busy)
    else:
        bars.none("plays that ended early", int(not ended["completed"]))
        missing = int(ended["expected_samples"]) - int(ended["samples"])
        unexplained = max(0, missing - int(ended["missed_deadlines"]))
        bars.none("samples neither played nor missed by the machine", unexplained)
        bars.least("changes", len(rig.changes), 7)
    bars.most("beyond slew x time, any window", beyond, SLEW / RATE_HZ + DAC_STEP_V, "V")
    return bars.end()


def change(rig: LongScan) -> None:
    """Make six model changes, and between them kill a gateway and reload the same model."""
    t = rig.seconds
    short, whole = scaled(1.15, 0.45), scaled(1.1)
    rig.do(0.07 * t, "SIGHUP, shorter reach", lambda: rig.reload(short))
    rig.do(0.15 * t, "SIGHUP, whole reach", lambda: rig.reload(whole))
    rig.do(0.25 * t, "accept, right model", lambda: rig.accept(11, scaled(1.0)))
    rig.do(0.40 * t, "accept, wrong model", lambda: rig.accept(22, scaled(1.5)))
    rig.do(0.60 * t, "gateway killed -9", rig.kill_gateway)
    rig.do(0.66 * t, "core reloaded, same model", lambda: rig.reload(None))
    rig.do(0.72 * t, "doctor.accept = true", lambda: rig.accepts_itself(33, scaled(1.02)))


if __name__ == "__main__":
    sys.exit(main())
