"""Tracking and speed of the inverse.

    python -m tests.benchmarks.bench_invert                    everything
    python -m tests.benchmarks.bench_invert --random 10000   the long property run
    python -m tests.benchmarks.bench_invert --only speed     one of plant, random, stage, speed

The plant of the first table is the paper's Eq. 12 forward model, without noise; rms errors in nm
after the first period.
"""

import argparse
import time

import numpy as np
from numpy.typing import NDArray
from tests.benchmarks import bench_invert_speed, bench_invert_stage
from tests.benchmarks.random_models import outcome

from dehyst.models.compensator import Compensator
from dehyst.models.forward import simulate
from dehyst.models.inverse_offline import invert_streamed, invert_trajectory
from dehyst.models.model import Model
from dehyst.models.modelfile import shipped

Floats = NDArray[np.float64]
CENTRE_UM = 6.0
TARGETS = (
    ("1 Hz, 9 um p-p", ((1.0, 1.0),), 9.0, 1.0),
    ("5 Hz, 6 um p-p", ((5.0, 1.0),), 6.0, 5.0),
    ("10 Hz, 4 um p-p", ((10.0, 1.0),), 4.0, 10.0),
    ("5 + 10 Hz, 8.5 um p-p", ((5.0, 3.0), (10.0, 2.0)), 8.5, 5.0),
    ("20 Hz, 2 um p-p", ((20.0, 1.0),), 2.0, 20.0),
)
BARS_100_MS, BARS_WHOLE = (8, 15, 25, 45, 45), (2, 2, 4, 4, 6)


def target_of(
    parts: tuple[tuple[float, float], ...], size: float, seconds: float, rate_hz: float
) -> Floats:
    """A sum of sines that starts at rest at its lowest point, `size` peak to peak."""
    t = np.arange(round(seconds * rate_hz)) / rate_hz
    y = sum(a * np.sin(2 * np.pi * f * t - np.pi / 2) for f, a in parts)
    y = np.asarray(y)
    return (y - 0.5 * (y.max() + y.min())) / np.ptp(y) * size + CENTRE_UM


def _rms_nm(model: Model, drive: Floats, target: Floats, rate_hz: float, skip: int) -> float:
    y = simulate(model.hysteresis, np.concatenate([[0.0], drive]), 1.0 / rate_hz)[1:]
    return 1e3 * float(np.sqrt(np.mean((y - target)[skip:] ** 2)))


def plant_tables() -> None:
    """Table 1: every mode at every sampling rate."""
    model = shipped("paper-eq12")
    for rate_hz in (1000.0, 200.0, 5000.0):
        print(f"\nplant: Eq. 12 at {rate_hz:g} Hz; rms error in nm after the first period")
        print(f"{'target':24}{'static':>9}{'causal':>9}{'50 ms':>9}{'100 ms':>9}{'bar':>5}"
              f"{'whole':>9}{'bar':>5}")  # fmt: skip
        rows = zip(TARGETS, BARS_100_MS, BARS_WHOLE, strict=True)
        for (name, parts, size, f), bar, whole_bar in rows:
            target = target_of(parts, size, max(4.0 / f, 2.0), rate_hz)
            skip = round(rate_hz / f)
            cells = []
            for mode, preview_s in (("static", 0.0), ("causal", 0.0), ("preview", 0.05),
                                    ("preview", 0.1)):  # fmt: skip
                c = Compensator(model, 1 / rate_hz, 0.0, 10.0, 1e4, mode, preview_s)
                drive = invert_streamed(c, target).drive
                cells.append(_rms_nm(model, drive, target, rate_hz, skip))
            whole = invert_trajectory(Compensator(model, 1 / rate_hz, 0.0, 10.0, 1e4), target)
            cells.append(_rms_nm(model, whole.drive, target, rate_hz, skip))
            print(f"{name:24}{cells[0]:9.0f}{cells[1]:9.0f}{cells[2]:9.1f}{cells[3]:9.1f}"
                  f"{bar:5d}{cells[4]:9.2f}{whole_bar:5d}", flush=True)  # fmt: skip


def random_models(first: int, last: int) -> None:
    """Table 2: random parameter sets and nasty targets, by seed."""
    print(f"\nrandom models {first} to {last - 1}, targets that jump, starve and leave the range")
    began = time.perf_counter()
    outcomes = {seed: outcome(seed) for seed in range(first, last)}
    print(
        f"drives not finite, out of range or slew: {sum(not o.limits for o in outcomes.values())}"
    )
    for mode in ("causal", "preview"):
        worse = {seed: o.excess(mode) for seed, o in outcomes.items()}
        failed = {seed: f"{e:.2g}" for seed, e in worse.items() if e > 1.0}
        gain = np.median([o.rms[mode] / o.rms["static"] for o in outcomes.values()])
        print(
            f"{mode}: {len(failed)} of {len(worse)} worse than static by more than the noise "
            f"(0.4 % of the stroke), worst by {max(worse.values()):.2g} times the noise; median "
            f"error {gain:.3f} of the static one's"
        )
        if failed:
            print("   by seed: " + ", ".join(f"{seed}: {e}" for seed, e in failed.items()))
    print(f"{time.perf_counter() - began:.0f} s")


def main() -> None:
    """Print the tables."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0] if __doc__ else "")
    parser.add_argument("--random", type=int, default=300, help="number of random models")
    parser.add_argument("--from", dest="first", type=int, default=0, help="their first seed")
    parser.add_argument("--only", choices=("plant", "random", "stage", "speed"))
    args = parser.parse_args()
    if args.only in (None, "plant"):
        plant_tables()
    if args.only in (None, "random"):
        random_models(args.first, args.first + args.random)
    if args.only in (None, "stage"):
        bench_invert_stage.table()
    if args.only in (None, "speed"):
        bench_invert_speed.table()


if __name__ == "__main__":
    main()
