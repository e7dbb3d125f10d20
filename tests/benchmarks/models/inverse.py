"""Tracking and speed of the inverse, against its bars (tests.benchmarks.bars).

    python -m tests.benchmarks.models.inverse                  everything
    python -m tests.benchmarks.models.inverse --random 5000    the long property run
    python -m tests.benchmarks.models.inverse --only speed     plant, steps, random, stage or speed

The plant of the first tables is the paper's Eq. 12 forward model, without noise; rms errors in nm
after the first period. The constants of dehyst.models.inverse.tuning are set by the table `plant`
and by random models with seeds below 10 000; those from 100 000 on are unseen.
"""

import argparse
import sys
import time
from multiprocessing import get_context

import numpy as np
from tests.benchmarks.bars import Bars
from tests.benchmarks.models import inverse_speed, inverse_stage
from tests.rigs.random_models import NEVER, Outcome, driven, outcome, random_case

from dehyst.models.arrays import Floats
from dehyst.models.hysteresis.forward import simulate_hysteresis
from dehyst.models.inverse.compensator import Compensator
from dehyst.models.inverse.offline import invert_streamed, invert_trajectory
from dehyst.models.model import Model
from dehyst.models.modelfile import shipped

CENTRE_UM = 6.0
TARGETS = (
    ("1 Hz, 9 um p-p", ((1.0, 1.0),), 9.0, 1.0),
    ("5 Hz, 6 um p-p", ((5.0, 1.0),), 6.0, 5.0),
    ("10 Hz, 4 um p-p", ((10.0, 1.0),), 4.0, 10.0),
    ("5 + 10 Hz, 8.5 um p-p", ((5.0, 3.0), (10.0, 2.0)), 8.5, 5.0),
    ("20 Hz, 2 um p-p", ((20.0, 1.0),), 2.0, 20.0),
)
BARS_PREVIEW = (8, 5, 4, 4, 4)
BARS_CAUSAL = (35, 110, 260, 450, 430)
BAR_WHOLE = 1
WORSE_SHARE, WORST_TIMES = 0.2, 3.0  # %, and with the noise added to both


def target_of(
    parts: tuple[tuple[float, float], ...], size: float, seconds: float, rate_hz: float
) -> Floats:
    """Return a sum of sines that starts at rest at its lowest point, `size` peak to peak."""
    t = np.arange(round(seconds * rate_hz)) / rate_hz
    y = sum(a * np.sin(2 * np.pi * f * t - np.pi / 2) for f, a in parts)
    y = np.asarray(y)
    return (y - 0.5 * (y.max() + y.min())) / np.ptp(y) * size + CENTRE_UM


def rms_nm(model: Model, drive: Floats, target: Floats, rate_hz: float, skip: int) -> float:
    """Return the error of the forward model along a drive from rest at 0."""
    y = simulate_hysteresis(model.hysteresis, np.concatenate([[0.0], drive]), 1.0 / rate_hz)[1:]
    return 1e3 * float(np.sqrt(np.mean((y - target)[skip:] ** 2)))


def plant_tables(bars: Bars) -> None:
    """Print every mode at every sampling rate; the bars are for 1 kHz."""
    model = shipped("paper-eq12")
    for rate_hz in (1000.0, 200.0, 5000.0):
        print(f"\nplant: Eq. 12 at {rate_hz:g} Hz; rms error in nm after the first period")
        print(
            f"{'target':24}{'static':>8}{'causal':>8}{'bar':>5}{'50 ms':>9}{'100 ms':>9}{'bar':>5}"
            f"{'whole':>9}{'bar':>5}"
        )
        rows = zip(TARGETS, BARS_CAUSAL, BARS_PREVIEW, strict=True)
        for (name, parts, size, f), causal_bar, preview_bar in rows:
            target = target_of(parts, size, max(4.0 / f, 2.0), rate_hz)
            skip = round(rate_hz / f)
            cells = []
            for mode, preview_s in (
                ("static", 0.0),
                ("causal", 0.0),
                ("preview", 0.05),
                ("preview", 0.1),
            ):
                c = Compensator(model, 1 / rate_hz, 0.0, 10.0, 1e4, mode, preview_s)
                held = np.append(target, np.full(c.window_samples, target[-1]))
                drive = driven(c, held, NEVER, 0.0)[: target.size]
                cells.append(rms_nm(model, drive, target, rate_hz, skip))
            whole = invert_trajectory(Compensator(model, 1 / rate_hz, 0.0, 10.0, 1e4), target)
            cells.append(rms_nm(model, whole.drive, target, rate_hz, skip))
            print(
                f"{name:24}{cells[0]:8.0f}{cells[1]:8.0f}{causal_bar:5d}{cells[2]:9.1f}"
                f"{cells[3]:9.1f}{preview_bar:5d}{cells[4]:9.2f}{BAR_WHOLE:5d}",
                flush=True,
            )
            if rate_hz == 1000.0:
                bars.most(f"causal, {name}", cells[1], causal_bar, "nm")
                bars.most(f"preview, {name}", cells[3], preview_bar, "nm")
                bars.most(f"whole trajectory, {name}", cells[4], BAR_WHOLE, "nm")


def steps_table(bars: Bars) -> None:
    """Print steps of 2 um on Eq. 12: the whole trajectory against the preview, all samples."""
    model = shipped("paper-eq12")
    print("\nsteps of 2 um every 50 ms on Eq. 12; rms error in nm, every sample counted")
    print(f"{'period':>8}{'static':>10}{'preview':>10}{'whole':>10}")
    for period_s in (2e-4, 1e-3, 5e-3):
        n = round(0.6 / period_s)
        target = CENTRE_UM + np.sign(np.sin(2 * np.pi * 10.0 * (np.arange(n) + 0.5) * period_s))
        args = (model, period_s, 0.0, 10.0, 1e4)
        drives = [
            invert_streamed(Compensator(*args, "static"), target).drive,
            invert_streamed(Compensator(*args, "preview"), target).drive,
            invert_trajectory(Compensator(*args, "preview"), target).drive,
        ]
        static, preview, whole = (rms_nm(model, d, target, 1 / period_s, 0) for d in drives)
        print(f"{1e3 * period_s:5.1f} ms{static:10.1f}{preview:10.1f}{whole:10.1f}", flush=True)
        bars.most(f"whole trajectory, steps at {1e3 * period_s:g} ms", whole, preview, "nm")


def _case(seed: int) -> tuple[int, Outcome]:
    return seed, outcome(seed, ("static", "preview"))


def random_models(first: int, last: int, processes: int, bars: Bars) -> None:
    """Run random parameter sets and difficult targets; print the ratio to static's error."""
    print(f"\nrandom models {first} to {last - 1}: targets that jump, starve and leave the range")
    began = time.perf_counter()
    seeds = range(first, last)
    if processes > 1:
        with get_context("spawn").Pool(processes) as pool:
            outcomes = dict(pool.imap_unordered(_case, seeds, chunksize=20))
    else:
        outcomes = dict(map(_case, seeds))
    bars.none("random models: drives out of limits", sum(not o.limits for o in outcomes.values()))
    for name, starved in (("window full", False), ("stream starved", True)):
        group = {s: o for s, o in outcomes.items() if (o.starving != NEVER) == starved}
        worse = {s: o for s, o in group.items() if o.excess("preview") > 1.0}
        gain = np.median([o.rms["preview"] / o.rms["static"] for o in group.values()])
        times = max(o.times("preview") for o in group.values())
        print(
            f"{name}: {len(group)} models, median error {gain:.3f} of the static one's; worse by "
            f"more than the noise in {len(worse)} ({100 * len(worse) / len(group):.2f} %), at most "
            f"{times:.2f} times the static error"
        )
        for seed, o in sorted(worse.items(), key=lambda item: -item[1].times("preview")):
            _, _, period, slew, target, _ = random_case(seed)
            print(
                f"   {seed}: {target} at {1e3 * period:g} ms, slew {slew:.3g}; static "
                f"{o.rms['static']:.2f}, preview {o.rms['preview']:.2f} times the noise"
            )
        if not starved:
            share = 100 * len(worse) / len(group)
            bars.most(f"random models, {name}: worse than static", share, WORSE_SHARE, "%")
        bars.most(f"random models, {name}: times the static error", times, WORST_TIMES)
    print(f"{time.perf_counter() - began:.0f} s")


def main() -> int:
    """Print the tables and the bars."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0] if __doc__ else "")
    parser.add_argument("--random", type=int, default=300, help="number of random models")
    parser.add_argument("--from", dest="first", type=int, default=100_000, help="their first seed")
    parser.add_argument("--processes", type=int, default=1, help="for the random models")
    parser.add_argument("--only", choices=("plant", "steps", "random", "stage", "speed"))
    args = parser.parse_args()
    bars = Bars()
    if args.only in (None, "plant"):
        plant_tables(bars)
    if args.only in (None, "steps"):
        steps_table(bars)
    if args.only in (None, "random"):
        random_models(args.first, args.first + args.random, args.processes, bars)
    if args.only in (None, "stage"):
        inverse_stage.table()
    if args.only in (None, "speed"):
        inverse_speed.table(bars)
    return bars.end()


if __name__ == "__main__":
    sys.exit(main())
