"""Record the simulated multi-axis stage, and let it follow targets, in virtual time.

No clock, no devices, no daemon: the daemon's compensators are called sample by sample.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from dehyst.daemon.acquire.axes import PACES
from dehyst.daemon.bench.simulated import FULL_SCALE_V
from dehyst.drivers.simulated.axes import Platform, settings_by_axis
from dehyst.models.inverse.compensator import Compensator
from dehyst.models.model import Model
from dehyst.models.recording import Floats, Recording

SLEW_V_PER_S = 4000.0  # of the emulated bench
EXERCISE_S = 5.0  # loops of 1 Hz over the range: a stage that has rested creeps


def record_platform(axes: Sequence[str], drive: Floats, rate_hz: float) -> dict[str, Recording]:
    """Return a recording of each axis, with the readings of its gauge. After an exercise, each axis
    plays the drive (N,) [V] alone, then all play it together, each at its own pace."""
    period_s = 1.0 / rate_hz
    stage = Platform(settings_by_axis(axes, {}))
    n, whole, count = drive.size, int(drive.size / min(PACES[: len(axes)])), len(axes)
    plan = np.zeros((count * n + whole, count))
    for k, pace in enumerate(PACES[:count]):
        plan[k * n : (k + 1) * n, k] = drive
        at = np.arange(whole) * pace
        plan[count * n :, k] = np.interp(at, np.arange(n), drive, right=drive[-1])
    turns = 2 * np.pi * np.arange(round(EXERCISE_S * rate_hz)) * period_s
    for volts in 0.5 * FULL_SCALE_V * (1.0 - np.cos(turns)):
        for axis in axes:
            stage.axes[axis].command(float(volts))
        stage.advance(period_s)
    shown = np.empty(plan.shape)
    for i, row in enumerate(plan.tolist()):
        for k, axis in enumerate(axes):
            shown[i, k] = stage.axes[axis].reading_um()
            stage.axes[axis].command(row[k])
        stage.advance(period_s)
    held = np.vstack([np.zeros((1, count)), plan[:-1]])  # a reading belongs to the previous voltage
    t_s = np.arange(plan.shape[0], dtype=np.float64) * period_s
    return {
        axis: Recording(
            t_s,
            held[:, k],
            shown[:, k],
            channels={f"axis.{a}": shown[:, j] for j, a in enumerate(axes) if a != axis},
            name=f"axis {axis}",
        )
        for k, axis in enumerate(axes)
    }


@dataclass(frozen=True)
class TrackingRun:
    """Result of following targets: true displacement, reading and volts of each axis (N,)."""

    true: dict[str, Floats]
    shown: dict[str, Floats]
    volts: dict[str, Floats]


class PlatformRun:
    """A stage that begins at rest and follows targets open loop, pass after pass.

    models: by axis; linear: use volts proportional to the target, by the model's mean slope,
    instead of its inverse. Raises BadInput on models that cannot be inverted.
    """

    def __init__(self, models: Mapping[str, Model], period_s: float, linear: bool = False) -> None:
        self.period_s, self._linear = period_s, linear
        self._stage = Platform(settings_by_axis(tuple(models), {}))
        self._comps = {
            axis: Compensator(model, period_s, 0.0, FULL_SCALE_V, SLEW_V_PER_S, "static")
            for axis, model in models.items()
        }
        self._states = {axis: comp.init(0.0) for axis, comp in self._comps.items()}
        self._volts = dict.fromkeys(models, 0.0)

    def follow(self, targets: Mapping[str, Floats]) -> TrackingRun:
        """Follow targets (N,) [um] of each axis, starting from the stage's present position."""
        n = next(iter(targets.values())).size
        out = [{axis: np.empty(n) for axis in targets} for _ in range(3)]
        true, shown, volts = out
        for i in range(n):
            row = {axis: float(of[i]) for axis, of in targets.items()}
            for axis in targets:
                self._volts[axis] = self._drive(axis, row)
                self._stage.axes[axis].command(self._volts[axis])
            self._stage.advance(self.period_s)
            for axis in targets:
                stage = self._stage.axes[axis]
                true[axis][i], shown[axis][i] = stage.displacement_um, stage.reading_um()
                volts[axis][i] = self._volts[axis]
        return TrackingRun(true, shown, volts)

    def _drive(self, axis: str, row: Mapping[str, float]) -> float:
        comp, state = self._comps[axis], self._states[axis]
        if self._linear:
            wanted = min(max(row[axis] / comp.slope, 0.0), FULL_SCALE_V)
            step = SLEW_V_PER_S * self.period_s
            return self._volts[axis] + min(max(wanted - self._volts[axis], -step), step)
        channels = np.array([row[name.split(".")[1]] for name in comp.channels])
        comp.step(state, np.array([row[axis]]), 1, channels)
        drive = state.drive
        comp.applied(state, drive)
        return drive
