"""Record several axes open loop: one after the other, then together.

While one axis moves and the others rest, its cross-coupling to them is seen in isolation; while all
move, each at its own pace, a model can be tested on the combination. Each axis gets its own
recording, with the displacements and drives of the others as channels.
"""

from collections.abc import Callable, Sequence

import numpy as np

from dehyst.daemon.acquire.one_axis import EXERCISE_S, check_drive, exercise, play_and_record
from dehyst.daemon.config import Config
from dehyst.models.recording import Floats, Recording

PACES = (1.0, 0.83, 0.71)
"""Pace of each axis while all move; the ratios are not those of small integers, so that no two axes
stay in step."""


def plan_axes(configs: Sequence[Config], t_s: Floats, drive: Floats) -> tuple[Floats, Floats]:
    """Return (N,) times and (N, axes) actuator volts: every axis plays the drive alone, then all
    play it together. drive: (M,), or (M, axes) with one for each axis. A waiting axis stays at the
    first value of its drive. Raises BadRecording if the drive violates an axis' limits."""
    drives = np.repeat(drive[:, None], len(configs), axis=1) if drive.ndim == 1 else drive
    period_s = 1.0 / configs[0].loop.rate_hz
    paces = [PACES[k % len(PACES)] ** (1 + k // len(PACES)) for k in range(len(configs))]
    length_s = float(t_s[-1] - t_s[0])
    home_s = 0.0  # from the end of the drive back to its beginning
    for config, own in zip(configs, drives.T, strict=True):
        volts = own * config.actuator.gain
        check_drive(config, t_s, volts)
        home_s = max(home_s, abs(volts[-1] - volts[0]) / config.safe.ramp_v_per_s)
    once = np.arange(0.0, length_s + home_s + period_s, period_s)
    whole = np.arange(0.0, length_s / min(paces) + home_s + period_s, period_s)
    n, axes = once.size, len(configs)
    out = np.repeat(drives[:1], n * axes + whole.size, axis=0)
    for k, (config, own) in enumerate(zip(configs, drives.T, strict=True)):
        out[k * n : (k + 1) * n, k] = _runs(t_s, own, once, 1.0, home_s)
        out[n * axes :, k] = _runs(t_s, own, whole, paces[k], home_s)
        out[:, k] *= config.actuator.gain
    times = np.arange(out.shape[0], dtype=np.float64) * period_s
    return times, out


def _runs(t_s: Floats, drive: Floats, at_s: Floats, pace: float, home_s: float) -> Floats:
    """Return the drive at this pace, followed by a ramp back to its first value within home_s."""
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
    """Return the recording of each axis by name, and the reason if it ended early. See `plan_axes`
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
    """Like `acquire_axes`, for volts_at (N, axes) [actuator volts] at the loop's rate, starting at
    t_s[0]. Also raises BadRecording if volts_at violates an axis' limits."""
    for k, config in enumerate(configs):
        check_drive(config, t_s, volts_at[:, k])
    period_s = 1.0 / configs[0].loop.rate_hz
    loops = [exercise(t_s, volts_at[:, k], exercise_s, period_s) for k in range(len(configs))]
    longest = max(one.size for one in loops)
    padded = [np.append(one, np.full(longest - one.size, one[-1:])) for one in loops]
    rows, ended = play_and_record(configs, volts_at, np.stack(padded, axis=1), progress, stop)
    return recordings_of(configs, rows, unit), ended


def recordings_of(configs: Sequence[Config], rows: Floats, unit: str) -> dict[str, Recording]:
    """Return one recording for each axis, from rows as returned by `play_and_record`."""
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
