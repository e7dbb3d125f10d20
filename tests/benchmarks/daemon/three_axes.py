"""Path errors of three coupled axes: linear, compensated, with coupling compensated, and learned.

    python -m tests.benchmarks.daemon.three_axes [--passes N]

In this process, by the true displacement of the simulated stage, at the rate of three axes on one
serial amplifier: every axis is identified from an open-loop recording (one after the other, then
together); x and y follow a raster of 5 x 5 um and a Lissajous figure while z holds its position.
Cross-talk of an axis is the change in its true displacement when the others move: the same targets
are run once with the others and once alone.
"""

import argparse
import sys
from collections.abc import Mapping
from dataclasses import replace

import numpy as np
from tests.benchmarks.bars import Bars

from dehyst.daemon.bench.simulated import AXES_RATE_HZ, exploring_drive
from dehyst.daemon.imaging.platform_run import PlatformRun, TrackingRun, record_platform
from dehyst.models.drive_design.scans import Scan, scan_lissajous, scan_raster
from dehyst.models.identify import identify
from dehyst.models.learning.passes import Learner, Pass
from dehyst.models.model import Model
from dehyst.models.recording import Floats

AXES = "xyz"
PERIOD_S = 1.0 / AXES_RATE_HZ
MIDDLE_UM = {"x": 8.0, "y": 7.5, "z": 8.5}
LEAST_GAIN = 3.0  # ratio of cross-talk without its compensation to that with it
APPROACH = 300  # samples at the first target before a path is judged
FIGURES = {
    "raster of 5 x 5 um": scan_raster(5.0, 5.0, 10, 0.5, PERIOD_S),
    "Lissajous figure of 5 x 5 um": scan_lissajous(5.0, 5.0, (2, 3), 3.0, PERIOD_S),
}


def follow(
    models: Mapping[str, Model], targets: Mapping[str, Floats], linear: bool
) -> tuple[PlatformRun, TrackingRun]:
    """Follow targets (N,) of each axis from rest, in virtual time, open loop."""
    run = PlatformRun(models, PERIOD_S, linear)
    run.follow({axis: np.full(APPROACH, target[0]) for axis, target in targets.items()})
    return run, run.follow(targets)


def error_nm(found: TrackingRun, targets: Mapping[str, Floats], axis: str) -> Floats:
    """Return the error about its mean, because the trim corrects the mean (N,)."""
    error = 1e3 * (found.true[axis] - targets[axis])
    return np.asarray(error - error.mean())


def targets_of(scan: Scan) -> dict[str, Floats]:
    """Return targets: x and y follow the scan, z holds its position."""
    still = np.full(scan.x.size, MIDDLE_UM["z"])
    return {"x": scan.x + MIDDLE_UM["x"], "y": scan.y + MIDDLE_UM["y"], "z": still}


def cross_talk_nm(models: Mapping[str, Model], scan: Scan, together: TrackingRun) -> float:
    """Return the rms over the axes of the others' contribution: the run with them minus alone."""
    whole, found = targets_of(scan), []
    for axis in AXES:
        alone = {a: t if a == axis else np.full(t.size, t[0]) for a, t in whole.items()}
        change = 1e3 * (together.true[axis] - follow(models, alone, False)[1].true[axis])
        found.append(float(np.std(change)))
    return float(np.sqrt(np.mean(np.square(found))))


def rms_nm(found: TrackingRun, targets: Mapping[str, Floats]) -> float:
    """Return the rms error of the path in the plane, over both axes."""
    x, y = (error_nm(found, targets, axis) for axis in "xy")
    return float(np.sqrt(np.mean(x**2 + y**2)))


def learned(models: Mapping[str, Model], scan: Scan, passes: int) -> tuple[Floats, Floats]:
    """Return (passes,) errors of the path, and of the resting z, each about its mean [nm]; every
    axis learns from its gauge. Passes follow each other directly, as in `dehyst play --repeat`."""
    targets = targets_of(scan)
    learners = {a: Learner(t, PERIOD_S, 0.02, 1.7) for a, t in targets.items()}
    plane, still = [], []
    run, found = follow(models, targets, False)
    for number in range(passes):
        sent = {a: learner.correction for a, learner in learners.items()}
        if number > 0:
            found = run.follow({a: targets[a] + sent[a] for a in AXES})
        plane.append(rms_nm(found, targets))
        still.append(float(np.std(error_nm(found, targets, "z"))))
        for axis, learner in learners.items():
            learner.take(Pass(found.shown[axis] - targets[axis], sent[axis]))
    return np.array(plane), np.array(still)


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0] if __doc__ else "")
    parser.add_argument("--passes", type=int, default=8)
    args = parser.parse_args()
    _, drive = exploring_drive(AXES_RATE_HZ, 20.0)
    bars, known = Bars(), record_platform(AXES, drive, AXES_RATE_HZ)
    with_others = {axis: identify([one]).model for axis, one in known.items()}
    alone = {axis: identify([replace(one, channels={})]).model for axis, one in known.items()}
    for axis, model in with_others.items():
        gains = ", ".join(
            f"{b.channel} {b.params['gain_um_per_unit']:+.4f}" for b in model.blocks if b.channel
        )
        print(f"axis {axis}: rms {1e3 * (model.fit.rms or 0):.1f} nm, without the others "
              f"{1e3 * (alone[axis].fit.rms or 0):.1f} nm; {gains}")  # fmt: skip
    for name, scan in FIGURES.items():
        targets = targets_of(scan)
        linear = rms_nm(follow(alone, targets, True)[1], targets)
        plain, coupled = (follow(one, targets, False)[1] for one in (alone, with_others))
        before, after = (rms_nm(found, targets) for found in (plain, coupled))
        talk = cross_talk_nm(alone, scan, plain), cross_talk_nm(with_others, scan, coupled)
        z = [float(np.std(error_nm(found, targets, "z"))) for found in (plain, coupled)]
        plane, still = learned(with_others, scan, args.passes)
        print(
            f"{name}: path error linear {linear:.0f}, compensated {before:.0f}, coupling "
            f"compensated {after:.0f}, learned {plane[-1]:.1f} nm; cross-talk {talk[0]:.1f} and "
            f"{talk[1]:.1f} nm; z that stands {z[0]:.1f}, {z[1]:.1f}, learned {still[-1]:.1f} nm"
        )
        bars.least(f"{name}: cross-talk, without over with", talk[0] / talk[1], LEAST_GAIN)
        bars.most(f"{name}: learned over coupling compensated", plane[-1] / after, 0.5)
    return bars.end()


if __name__ == "__main__":
    sys.exit(main())
