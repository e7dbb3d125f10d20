"""Check that every trial of an offered model is judged, and correctly, however the stage is moved.

    python -m tests.benchmarks.daemon.trials

The stage has a lag of 20 ms; the model in use lacks the lag and its gain is 20 % too large. Models
are offered with (a lag block, which requires preview) and without preview, right and wrong ones,
under set-points, holds of 6 s, steps, a raster, and at rest. Times are in samples.
"""

import sys
import tempfile
from pathlib import Path

from tests.rigs.trials import (
    LAG_S,
    SET,
    Motion,
    TrialRig,
    raster,
    reloads,
    rest,
    scaled,
    small_steps,
)

TRIAL_S, MOST_S = 3.0, 90.0
MOTIONS: dict[str, tuple[Motion, bool]] = {
    **{name: (motion, False) for name, motion in SET.items()},
    "small steps": (small_steps, False),
    "raster": (raster, True),
    "rest": (rest, False),
}
CHANGING = ("raster, then steps", "steps, then small steps", "steps, then set-points")
"""Motions that change at the offer."""
OFFERS: dict[str, tuple[float, bool, str]] = {
    "right, preview": (1.0, True, "accepted"),
    "wrong, preview": (1.5, True, "returned"),
    "right, no preview": (1.0, False, "accepted"),
    "wrong, no preview": (1.5, False, "returned"),
}
"""Gain of the offered model, whether it has the lag, and the expected result."""


def one(name: str, what: str) -> tuple[str, bool]:
    """Return a row of the table, and whether it is as expected."""
    before, _, after = name.partition(", then ")
    first, first_played = MOTIONS[before]
    motion, played = MOTIONS[after or before]
    gain, lag, wanted = OFFERS[what]
    with tempfile.TemporaryDirectory() as folder:
        rig = TrialRig(Path(folder), scaled(1.2), TRIAL_S, MOST_S, LAG_S if lag else 0.0)
        with reloads(rig):
            rig.go(first, 10.0, first_played)
            rig.offer(scaled(gain, lag))
            over = rig.until_over(motion, played, MOST_S + 20.0)
            seconds = rig.now_s - rig.begun_s
    state, words = ("trial", "not over") if over is None else over[1:]
    good = state in (wanted, "accepted" if name == "rest" else wanted) and seconds <= MOST_S + 1.0
    return f"| {name} | {what} | {state} | {seconds:.1f} | {words} |", good


def main() -> int:
    """Print the table; return 1 if a row is not as expected."""
    print("| motion | offered | became | after [s] | in words |\n|---|---|---|---|---|")
    bad = 0
    for name in (*MOTIONS, *CHANGING):
        for what in OFFERS:
            row, good = one(name, what)
            bad += not good
            print(row + ("" if good else " **not as it should be** |"), flush=True)
    print(f"{bad} of {len((*MOTIONS, *CHANGING)) * len(OFFERS)} not as they should be")
    return int(bad > 0)


if __name__ == "__main__":
    sys.exit(main())
