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
    """(N,) times and (N, axes) actuator volts: every axis goes through the drive alone, then all
    together. An axis that waits stands at the drive's first value. Raises BadRecording where an
    axis' limits forbid it."""
    period_s = 1.0 / configs[0].loop.rate_hz
    paces = [PACES[k % len(PACES)] ** (1 + k // len(PACES)) for k in range(len(configs))]
    length_s = float(t_s[-1] - t_s[0])
    home_s = 0.0  # from the drive's end back to its begin
    for config in configs:
        volts = drive * config.actuator.gain
        check_drive(config, t_s, volts)
        home_s = max(home_s, abs(volts[-1] - volts[0]) / config.safe.ramp_v_per_s)
    once = np.arange(0.0, length_s + home_s + period_s, period_s)
    alone = _runs(t_s, drive, once, 1.0, home_s)
    whole = np.arange(0.0, length_s / min(paces) + home_s + period_s, period_s)
    n, axes = once.size, len(configs)
    out = np.full((n * axes + whole.size, axes), float(drive[0]))
    for k, config in enumerate(configs):
        out[k * n : (k + 1) * n, k] = alone
        out[n * axes :, k] = _runs(t_s, drive, whole, paces[k], home_s)
        out[:, k] *= config.actuator.gain
    times = np.arange(out.shape[0], dtype=np.float64) * period_s
    for k, config in enumerate(configs):
        check_drive(config, times, out[:, k])
    return times, out


def _runs(t_s: Floats, drive: Floats, at_s: Floats, pace: float, home_s: float) -> Floats:
    """The drive at this pace, then home to its first value within home_s."""
    times = np.append((t_s - t_s[0]) / pace, (t_s[-1] - t_s[0]) / pace + max(home_s, 1e-9))
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
    period_s = 1.0 / configs[0].loop.rate_hz
    loops = [exercise(times, volts_at[:, k], exercise_s, period_s) for k in range(len(configs))]
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
