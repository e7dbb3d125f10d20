"""Check that the stage returns to its target after its loop has died, and after a gauge fault ends.

    python -m tests.benchmarks.daemon.trim_anew

It uses the trimmed simulated stage in this process, with time counted in samples. The loop dies
twenty times, each time after 4 s of motion anywhere in the reach; the reading afterwards is correct
or off by a fraction of the reach, like a gauge that warms up or was bumped. Then a gauge drifts by
3 um in 30 s and jumps back to the truth. Bar: within 0.03 um of the target (of the gauge's own
zero), not frozen.
"""

import sys

import numpy as np
from tests.rigs.trim_anew import ON_TARGET_UM, RATE_HZ, die, drift, error_um, frozen, rig, wander
from tests.rigs.trimmed_stage import TrimmedStage

DEATHS, SHARES = 20, (0.0, 0.02, -0.02)
WATCHED_S = 15.0
DRIFT_UM, DRIFT_S = 3.0, 30.0


def seconds_until_on_target(one: TrimmedStage, watched_s: float, off: float) -> float:
    """Return when the mean distance over half a second is finally within the bar; nan: never."""
    n, width = round(watched_s * RATE_HZ), round(0.5 * RATE_HZ)
    away = one.true_um[-n:] + off - one.telemetry["target"][-n:]
    mean = np.convolve(away, np.full(width, 1 / width), "valid")
    far = np.flatnonzero(np.abs(mean) >= ON_TARGET_UM)
    if far.size == 0:
        return 0.0
    return float("nan") if far[-1] == mean.size - 1 else float((far[-1] + width) / RATE_HZ)


def one_death(one: TrimmedStage, number: int, share: float) -> tuple[float, bool, float]:
    """Return the final distance [um], whether trim is frozen, and seconds until on target."""
    low, high = one.reach
    wander(one, 4.0, number)
    die(one)
    off = share * (high - low)
    one.go(0.5 * (low + high), WATCHED_S, lambda _, reading: reading + off)
    return error_um(one, off), frozen(one), seconds_until_on_target(one, WATCHED_S, off)


def drift_and_back(one: TrimmedStage) -> tuple[float, float, bool, float]:
    """Return the distance at the drift's end and after it [um], whether frozen, and the seconds
    until on target."""
    drift(one, DRIFT_UM, DRIFT_S)
    at_worst = error_um(one)
    one.go(0.5 * sum(one.reach), WATCHED_S)
    return at_worst, error_um(one), frozen(one), seconds_until_on_target(one, WATCHED_S, 0.0)


def main() -> int:
    """Print the table; return 1 if the stage is not on target again."""
    print("| after | on target again | frozen | largest distance, nm | slowest, s |")
    print("|---|---|---|---|---|")
    bad = 0
    for share in SHARES:
        one = rig()
        ends = [one_death(one, number, share) for number in range(DEATHS)]
        good = sum(abs(um) < ON_TARGET_UM and not ice for um, ice, _ in ends)
        bad += DEATHS - good
        print(
            f"| {DEATHS} deaths of the loop, the gauge off by {100 * share:.0f} % of the reach | "
            f"{good} of {DEATHS} | {sum(ice for _, ice, _ in ends)} | "
            f"{1e3 * max(abs(um) for um, *_ in ends):.1f} | {max(s for *_, s in ends):.1f} |",
            flush=True,
        )
    at_worst, after, ice, seconds = drift_and_back(rig())
    good = abs(after) < ON_TARGET_UM and not ice
    bad += not good
    print(
        f"| a gauge that drifted by {DRIFT_UM:g} um in {DRIFT_S:g} s ({1e3 * abs(at_worst):.0f} nm "
        f"away by then) and jumped back | {int(good)} of 1 | {int(ice)} | "
        f"{1e3 * abs(after):.1f} | {seconds:.1f} |"
    )
    return int(bad > 0)


if __name__ == "__main__":
    sys.exit(main())
