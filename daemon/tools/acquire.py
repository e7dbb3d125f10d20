"""Open-loop recording: play a drive in volts through the drivers and record what the stage does.

For identification, before there is a model. The output starts and ends where it was, the way to
the drive's first and from its last voltage goes at the configured ramp; range and slew are
checked for the whole drive before anything moves.
"""

from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from dehyst.daemon import clock
from dehyst.daemon.config import Config
from dehyst.daemon.loop.checks import check_limits, check_rates, past_output
from dehyst.daemon.loop.devices import DeviceLink, ramp
from dehyst.daemon.loop.systemcalls import sleeper
from dehyst.daemon.loop.timing import realtime
from dehyst.drivers.interface import DriverError
from dehyst.drivers.registry import load_actuator, load_sensor
from dehyst.models.errors import BadRecording
from dehyst.models.recording import Floats, Recording

EXERCISE_S = 5.0


def check_drive(config: Config, t_s: Floats, volts: Floats) -> None:
    """Raise BadRecording where a drive [actuator volts] leaves range or slew."""
    limits = config.limits
    if not np.all(np.isfinite(volts)):
        raise BadRecording("the drive has missing values; nothing was moved")
    if volts.min() < limits.min_v or volts.max() > limits.max_v:
        raise BadRecording(
            f"the drive spans {volts.min():g} to {volts.max():g} V, the limits are "
            f"{limits.min_v:g} to {limits.max_v:g} V; nothing was moved"
        )
    rate = np.abs(np.diff(volts) / np.diff(t_s))
    if rate.size and rate.max() > limits.slew_v_per_s:
        at = float(t_s[int(np.argmax(rate))])
        raise BadRecording(
            f"the drive changes by {rate.max():g} V/s at {at:.3f} s, limits.slew_v_per_s is "
            f"{limits.slew_v_per_s:g}; nothing was moved"
        )


def exercise(t_s: Floats, volts: Floats, seconds: float, period_s: float) -> Floats:
    """Full loops between the drive's ends before it is recorded, no faster than the drive itself.

    A stage that has rested creeps for the first loops, and a model identified from them is off by
    what later loops no longer do: on the simulated stage the tracking error is a third after five
    seconds of exercise. Empty for 0 seconds or a drive that does not move.
    """
    low, span = float(volts.min()), float(np.ptp(volts))
    if seconds <= 0 or span == 0:
        return np.zeros(0)
    fastest = float(np.max(np.abs(np.diff(volts) / np.diff(t_s))))
    f_hz = min(1.0, fastest / (np.pi * span))
    time_s = np.arange(0.0, max(1, round(seconds * f_hz)) / f_hz, period_s)
    return np.asarray(low + 0.5 * span * (1.0 - np.cos(2 * np.pi * f_hz * time_s)))


def acquire(
    config: Config,
    t_s: Floats,
    drive: Floats,
    unit: str = "v",
    exercise_s: float = EXERCISE_S,
    progress: Callable[[float], None] | None = None,
    stop: Callable[[], str] = str,
) -> tuple[Recording, str]:
    """Play `drive` [model drive units] at loop.rate_hz and record, at the loop's priority.

    The stage is exercised first (see `exercise`). The drive is interpolated on the loop's grid;
    time stamps are the real ones, a reading that failed is NaN, a late sample shows as a gap.
    Where `stop` gives a reason, or a device fails, it ends early: what was recorded so far comes
    back with the reason, "" at the drive's end. Raises DriverError, BadInput, BadRecording; also
    where it ended before the first sample.
    """
    volts = drive * config.actuator.gain
    check_drive(config, t_s, volts)
    grid = np.arange(t_s[0], t_s[-1], 1.0 / config.loop.rate_hz)
    rows = np.full((grid.size, 3), np.nan)
    ended = ""
    try:
        with realtime.raised(config.loop.priority):
            volts_at = np.interp(grid, t_s, volts)
            loops = exercise(t_s, volts, exercise_s, 1.0 / config.loop.rate_hz)
            player = _Player(config, stop, sleeper())
            ended = _run(player, loops, volts_at, rows, progress)
    except DriverError as error:
        if not np.isfinite(rows[:, 0]).any():
            raise
        ended = str(error)
    rows = rows[np.isfinite(rows[:, 0])]
    if not rows.size:
        raise BadRecording(f"nothing was recorded: {ended or 'every sample came too late'}")
    recording = Recording(
        t_s=rows[:, 0],
        drive=rows[:, 1] / config.actuator.gain,
        displacement=rows[:, 2],
        drive_unit=unit,
        name=f"{config.name} open loop",
    )
    return recording, ended


class _Player(NamedTuple):
    """What playing needs beside the devices."""

    config: Config
    stop: Callable[[], str]
    sleep_until: Callable[[int], object]


def _run(
    player: _Player,
    loops: Floats,
    volts_at: Floats,
    rows: Floats,
    progress: Callable[[float], None] | None,
) -> str:
    """Fill the (N, 3) rows of time, voltage in force and reading; the output ends where it was.
    The reason where it ended early."""
    config = player.config
    actuator = DeviceLink(
        "actuator", load_actuator(config.actuator.driver).from_settings(config.actuator.settings)
    )
    sensor = DeviceLink(
        "sensor", load_sensor(config.sensor.driver).from_settings(config.sensor.settings)
    )
    actuator.device.open()
    try:
        sensor.device.open()
        check_limits(config, actuator.device.spec)
        check_rates(config, actuator.device.spec, sensor.device.spec)
        past, _ = past_output(config, float(actuator.device.output()))
        start = float(past[-1])
        rate, period_s = config.safe.ramp_v_per_s, 1.0 / config.loop.rate_hz
        try:
            at, ended = start, ""
            if loops.size:
                at = ramp(actuator, at, float(loops[0]), rate, period_s)
                unread = np.zeros((loops.size, 3))
                ended = _play(player, actuator, sensor, loops, unread, None)
                at = float(actuator.device.output())
            if not ended:
                ramp(actuator, at, float(volts_at[0]), rate, period_s)
                ended = _play(player, actuator, sensor, volts_at, rows, progress)
        finally:
            if actuator.ok:  # back from wherever it stands, also when it was interrupted
                ramp(actuator, float(actuator.device.output()), start, rate, period_s)
    finally:
        sensor.close()
        actuator.close()
    return ended


def _play(
    player: _Player,
    actuator: DeviceLink,
    sensor: DeviceLink,
    volts_at: Floats,
    rows: Floats,
    progress: Callable[[float], None] | None,
) -> str:
    """Write volts_at, one voltage a period; the reason where it ended early."""
    config = player.config
    first = clock.monotonic_ns() + config.period_ns
    at = float(volts_at[0])
    for i, volts in enumerate(volts_at.tolist()):
        if reason := player.stop():
            return reason
        due = first + i * config.period_ns
        if clock.monotonic_ns() > due + config.period_ns:
            continue  # too late for this sample: a gap, not a burst
        player.sleep_until(due)
        time_ns = clock.monotonic_ns()
        try:
            reading = sensor.device.read() * config.sensor.scale + config.sensor.zero
        except DriverError:
            reading = np.nan
        actuator.call(actuator.device.write, volts)
        # the reading was taken before this write: it belongs to the drive before it
        rows[i] = (time_ns - first) * 1e-9, at, reading
        at = volts
        if progress is not None and i % 64 == 0:
            progress(i / volts_at.size)
    return ""
