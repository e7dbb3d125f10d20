"""Three axes that move each other: path errors with linear gains, compensated, with coupling
compensated, and learned.

    python -m tests.benchmarks.daemon.three_axes [--passes N]

In this process, by the true displacement of the simulated stage, at the rate of three axes on one
serial amplifier: every axis is identified from an open-loop recording (one after the other, then
together), a raster of 5 x 5 um and a Lissajous figure are followed by x and y while z stands.
Cross-talk of an axis is what changes in its true displacement when the others move: the same
targets once with the others and once alone.
"""

import argparse
import sys
from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np
from tests.benchmarks.bars import Bars

from dehyst.daemon.tools.acquire_axes import PACES
from dehyst.daemon.tools.bench_config import AXES_RATE_HZ, FULL_SCALE_V, exploring_drive
from dehyst.drivers.simulated.axes import Platform, settings_of
from dehyst.models.drive_design.scans import Scan, scan_lissajous, scan_raster
from dehyst.models.identify import identify
from dehyst.models.inverse.compensator import Compensator
from dehyst.models.learning.passes import Learner, Pass
from dehyst.models.model import Model
from dehyst.models.recording import Floats, Recording

AXES = "xyz"
PERIOD_S = 1.0 / AXES_RATE_HZ
SLEW_V_PER_S = 4000.0
MIDDLE_UM = {"x": 8.0, "y": 7.5, "z": 8.5}
LEAST_GAIN = 3.0  # cross-talk without its compensation over that with it
APPROACH = 300  # samples at the first target before a path is judged
FIGURES = {
    "raster of 5 x 5 um": scan_raster(5.0, 5.0, 10, 0.5, PERIOD_S),
    "Lissajous figure of 5 x 5 um": scan_lissajous(5.0, 5.0, (2, 3), 3.0, PERIOD_S),
}


def recordings() -> dict[str, Recording]:
    """Each axis alone, then all together, from rest after exercise; readings, not truth."""
    stage = Platform(settings_of(AXES, {}))
    _, drive = exploring_drive(AXES_RATE_HZ, 20.0)
    n, whole = drive.size, int(drive.size / min(PACES))
    plan = np.zeros((3 * n + whole, 3))
    for k, pace in enumerate(PACES):
        plan[k * n : (k + 1) * n, k] = drive
        plan[3 * n :, k] = np.interp(np.arange(whole) * pace, np.arange(n), drive, right=drive[-1])
    for volts in 0.5 * FULL_SCALE_V * (1.0 - np.cos(2 * np.pi * np.arange(500) * PERIOD_S)):
        for axis in AXES:
            stage.axes[axis].command(volts)
        stage.advance(PERIOD_S)
    held = np.vstack([np.zeros((1, 3)), plan[:-1]])
    shown = np.empty(plan.shape)
    for i, row in enumerate(plan):
        for k, axis in enumerate(AXES):
            shown[i, k] = stage.axes[axis].reading_um()
            stage.axes[axis].command(row[k])
        stage.advance(PERIOD_S)
    t_s = np.arange(plan.shape[0]) * PERIOD_S
    return {
        axis: Recording(
            t_s,
            held[:, k],
            shown[:, k],
            channels={f"axis.{a}": shown[:, j] for j, a in enumerate(AXES) if a != axis},
            name=f"axis {axis}",
        )
        for k, axis in enumerate(AXES)
    }


@dataclass
class Followed:
    """What came of following targets: true displacement and reading of each axis (N,), um."""

    true: dict[str, Floats]
    shown: dict[str, Floats]

    def error_nm(self, targets: Mapping[str, Floats], axis: str) -> Floats:
        """About its mean, which is the trim's business."""
        error = 1e3 * (self.true[axis] - targets[axis])
        return np.asarray(error - error.mean())


def follow(models: Mapping[str, Model], targets: Mapping[str, Floats], linear: bool) -> Followed:
    """Follow targets (N,) of each axis from rest, in virtual time, open loop."""
    stage = Platform(settings_of(AXES, {}))
    comps = {
        a: Compensator(m, PERIOD_S, 0.0, FULL_SCALE_V, SLEW_V_PER_S, "static")
        for a, m in models.items()
    }
    states = {a: comp.init(0.0) for a, comp in comps.items()}
    n = targets["x"].size
    out = Followed({a: np.empty(n) for a in AXES}, {a: np.empty(n) for a in AXES})
    at = dict.fromkeys(AXES, 0.0)
    for i in range(-APPROACH, n):
        row = {a: float(targets[a][max(0, i)]) for a in AXES}
        for axis, comp in comps.items():
            if linear:
                drive = np.clip(row[axis] / comp.slope, 0.0, FULL_SCALE_V)
                step = SLEW_V_PER_S * PERIOD_S
                at[axis] += float(np.clip(drive - at[axis], -step, step))
            else:
                channels = np.array([row[name.split(".")[1]] for name in comp.channels])
                comp.step(states[axis], np.array([row[axis]]), 1, channels)
                at[axis] = states[axis].drive
                comp.applied(states[axis], at[axis])
            stage.axes[axis].command(at[axis])
        stage.advance(PERIOD_S)
        if i >= 0:
            for axis in AXES:
                out.true[axis][i] = stage.axes[axis].displacement_um
                out.shown[axis][i] = stage.axes[axis].reading_um()
    return out


def targets_of(scan: Scan) -> dict[str, Floats]:
    """x and y run through it, z stands."""
    still = np.full(scan.x.size, MIDDLE_UM["z"])
    return {"x": scan.x + MIDDLE_UM["x"], "y": scan.y + MIDDLE_UM["y"], "z": still}


def cross_talk_nm(models: Mapping[str, Model], scan: Scan, together: Followed) -> float:
    """Rms over the axes of what the others bring: with them, less alone."""
    whole, found = targets_of(scan), []
    for axis in AXES:
        alone = {a: t if a == axis else np.full(t.size, t[0]) for a, t in whole.items()}
        change = 1e3 * (together.true[axis] - follow(models, alone, False).true[axis])
        found.append(float(np.std(change)))
    return float(np.sqrt(np.mean(np.square(found))))


def rms_nm(found: Followed, targets: Mapping[str, Floats]) -> float:
    """Of the path in the plane: both axes."""
    x, y = (found.error_nm(targets, axis) for axis in "xy")
    return float(np.sqrt(np.mean(x**2 + y**2)))


def learned(models: Mapping[str, Model], scan: Scan, passes: int) -> tuple[Floats, Floats]:
    """(passes,) error of the path, and of z that stands, each about its mean [nm]; every axis
    learns from its gauge. Passes follow on each other, as `dehyst play --repeat` has them."""
    targets, n = targets_of(scan), scan.x.size
    learners = {a: Learner(t, PERIOD_S, 0.02, 1.7) for a, t in targets.items()}
    sent = {a: [np.zeros(n)] for a in AXES}
    plane, still = [], []
    for number in range(passes):
        asked = {a: np.concatenate([targets[a] + u for u in sent[a]]) for a in AXES}
        found = follow(models, asked, False)  # deterministic: passes before are as they were
        last = slice(number * n, None)
        errors = {a: found.true[a][last] - targets[a] for a in AXES}
        centred = {a: 1e3 * (e - e.mean()) for a, e in errors.items()}
        plane.append(float(np.sqrt(np.mean(centred["x"] ** 2 + centred["y"] ** 2))))
        still.append(float(np.std(centred["z"])))
        for axis, learner in learners.items():
            error = found.shown[axis][last] - targets[axis]
            learner.take(Pass(error, sent[axis][-1]))
            sent[axis].append(learner.correction.copy())
    return np.array(plane), np.array(still)


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0] if __doc__ else "")
    parser.add_argument("--passes", type=int, default=8)
    args = parser.parse_args()
    bars, known = Bars(), recordings()
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
        linear = rms_nm(follow(alone, targets, True), targets)
        plain, coupled = follow(alone, targets, False), follow(with_others, targets, False)
        before, after = (rms_nm(found, targets) for found in (plain, coupled))
        talk = cross_talk_nm(alone, scan, plain), cross_talk_nm(with_others, scan, coupled)
        z = [float(np.std(found.error_nm(targets, "z"))) for found in (plain, coupled)]
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
