"""Open-loop recording of several axes: one after the other, then together.

While one axis moves and the others rest, what it brings to them is plain; while all move, each at
its own pace, a model shows whether it foretells all of it. Each axis gets a recording of its own,
in which the displacements and drives of the others stand as channels.
"""

from collections.abc import Callable, Sequence

import numpy as np

from dehyst.daemon.config import Config
from dehyst.daemon.tools.acquire import EXERCISE_S, check_drive, exercise, play_and_record
from dehyst.models.recording import Floats, Recording

PACES = (1.0, 0.83, 0.71)
"""How fast each axis goes through the drive while all move: their ratios are no small ones, so that
no two stay in step."""


def plan_axes(configs: Sequence[Config], t_s: Floats, drive: Floats) -> tuple[Floats, Floats]:
    """(N,) times and (N, axes) actuator volts; see `lay_out`. drive: (M,), or (M, axes) with one
    for each. Raises BadRecording where an axis' limits forbid it."""
    drives = np.repeat(drive[:, None], len(configs), axis=1) if drive.ndim == 1 else drive
    period_s = 1.0 / configs[0].loop.rate_hz
    home_s = wait_s = 0.0
    for config, own in zip(configs, drives.T, strict=True):
        volts = own * config.actuator.gain
        check_drive(config, t_s, volts)
        home_s = max(home_s, abs(volts[-1] - volts[0]) / config.safe.ramp_v_per_s)
        wait_s = max(wait_s, abs(volts.mean() - volts[0]) / config.safe.ramp_v_per_s)
    out = lay_out(t_s - t_s[0], drives, period_s, home_s, wait_s)
    out *= np.array([config.actuator.gain for config in configs])
    return np.arange(out.shape[0], dtype=np.float64) * period_s, out


def lay_out(t_s: Floats, drives: Floats, period_s: float, home_s: float, wait_s: float) -> Floats:
    """(N, axes) of drives (M, axes) at t_s from 0 on: every axis goes through its drive alone, then
    all together. home_s: for the way from a drive's end to its first value; wait_s: for that
    between its first value and its mean.

    An axis whose turn has not come waits at its drive's mean. At one end of its range it would
    creep for as long as it rests, and creep back when it moves, which no model has; at the mean it
    stays where it will be (tests.benchmarks.daemon.three_axes). Behind its turn it waits at the
    first value, from which all go on together.
    """
    axes, means = drives.shape[1], drives.mean(axis=0)
    paces = [PACES[k % len(PACES)] ** (1 + k // len(PACES)) for k in range(axes)]
    once = np.arange(0.0, t_s[-1] + home_s + period_s, period_s)
    whole = np.arange(0.0, t_s[-1] / min(paces) + home_s + period_s, period_s)
    steps = int(np.ceil(wait_s / period_s)) + 1
    lead = np.arange(steps) / steps  # shares of the way
    n = lead.size + once.size
    together = n * axes - lead.size
    out = np.repeat(drives[:1], together + whole.size, axis=0)
    for k in range(axes):
        own, begin = drives[:, k], k * n
        if k:  # the first has no way to go
            out[: begin - lead.size, k] = means[k]
            out[begin - lead.size : begin, k] = means[k] + lead * (own[0] - means[k])
        out[begin : begin + once.size, k] = _runs(t_s, own, once, 1.0, home_s)
        out[together:, k] = _runs(t_s, own, whole, paces[k], home_s)
    return out


def _runs(t_s: Floats, drive: Floats, at_s: Floats, pace: float, home_s: float) -> Floats:
    """The drive at this pace, then home to its first value within home_s."""
    times = np.append(t_s / pace, t_s[-1] / pace + max(home_s, 1e-9))
    return np.interp(at_s, times, np.append(drive, drive[0]))


def acquire_axes(
    configs: Sequence[Config],
    t_s: Floats,
    drive: Floats,
    unit: str = "v",
    exercise_s: float = EXERCISE_S,
    progress: Callable[[float], None] | None = None,
    stop: Callable[[], str] = str,
) -> tuple[dict[str, Recording], str]:
    """The recording of each axis by its name, and the reason where it ended early; see `plan_axes`
    and `acquire`, whose errors it raises."""
    times, volts_at = plan_axes(configs, t_s, drive)
    return play_axes(configs, times, volts_at, unit, exercise_s, progress, stop)


def play_axes(
    configs: Sequence[Config],
    t_s: Floats,
    volts_at: Floats,
    unit: str = "v",
    exercise_s: float = EXERCISE_S,
    progress: Callable[[float], None] | None = None,
    stop: Callable[[], str] = str,
) -> tuple[dict[str, Recording], str]:
    """As `acquire_axes`, of volts_at (N, axes) [actuator volts] at the loop's rate from t_s[0] on.
    Raises BadRecording, too, where an axis' limits forbid it."""
    for k, config in enumerate(configs):
        check_drive(config, t_s, volts_at[:, k])
    period_s = 1.0 / configs[0].loop.rate_hz
    loops = [exercise(t_s, volts_at[:, k], exercise_s, period_s) for k in range(len(configs))]
    longest = max(one.size for one in loops)
    padded = [np.append(one, np.full(longest - one.size, one[-1:])) for one in loops]
    rows, ended = play_and_record(configs, volts_at, np.stack(padded, axis=1), progress, stop)
    return recordings_of(configs, rows, unit), ended


def recordings_of(configs: Sequence[Config], rows: Floats, unit: str) -> dict[str, Recording]:
    """One recording for each axis, of rows as `play_and_record` has them."""
    drives = {c.axis: rows[:, 1 + 2 * k] / c.actuator.gain for k, c in enumerate(configs)}
    readings = {c.axis: rows[:, 2 + 2 * k] for k, c in enumerate(configs)}
    out = {}
    for config in configs:
        others = [name for name in drives if name != config.axis]
        channels = {f"axis.{name}": readings[name] for name in others}
        channels |= {f"axis.{name}.drive": drives[name] for name in others}
        out[config.axis] = Recording(
            t_s=rows[:, 0],
            drive=drives[config.axis],
            displacement=readings[config.axis],
            drive_unit=unit,
            channels=channels,
            name=f"{config.name} open loop",
        )
    return out
