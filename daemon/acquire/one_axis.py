"""Record open loop: play a drive in volts through the drivers and record the stage's response.

Used for identification, before there is a model. The output ends where it started; it is ramped at
the configured rate to the first voltage of the drive, and back from the last. Range and slew rate
are checked for the whole drive before anything moves. No write changes the output by more than the
slew limit allows in one period, not even after a pause of this process.
"""

from collections.abc import Callable, Sequence
from typing import NamedTuple

import numpy as np

from dehyst.daemon import clock
from dehyst.daemon.acquire.outputs import DrivenOutput, return_all, toward
from dehyst.daemon.config import Config
from dehyst.daemon.files.known_units import SENSOR, open_known
from dehyst.daemon.loop.checks import check_limits, check_rates_together, joined
from dehyst.daemon.loop.devices import DeviceLink
from dehyst.daemon.loop.systemcalls import sleeper
from dehyst.daemon.loop.timing import realtime
from dehyst.drivers.interface import DriverError
from dehyst.drivers.registry import load_actuator, load_sensor
from dehyst.models.errors import BadRecording
from dehyst.models.recording import Floats, Recording

EXERCISE_S = 5.0  # of loops before a recording: a stage that has rested creeps


def check_drive(config: Config, t_s: Floats, volts: Floats) -> None:
    """Raise BadRecording if a drive [actuator volts] exceeds the range or the slew rate."""
    limits, whose = config.limits, f"axis {config.axis}: " if config.axis else ""
    if not np.all(np.isfinite(volts)):
        raise BadRecording(f"{whose}the drive has missing values; nothing was moved")
    if volts.min() < limits.min_v or volts.max() > limits.max_v:
        raise BadRecording(
            f"{whose}the drive spans {volts.min():g} to {volts.max():g} V, the limits are "
            f"{limits.min_v:g} to {limits.max_v:g} V; nothing was moved"
        )
    rate = np.abs(np.diff(volts) / np.diff(t_s))
    if rate.size and rate.max() > limits.slew_v_per_s:
        at = float(t_s[int(np.argmax(rate))])
        raise BadRecording(
            f"{whose}the drive changes by {rate.max():g} V/s at {at:.3f} s, limits.slew_v_per_s is "
            f"{limits.slew_v_per_s:g}; nothing was moved"
        )


def exercise(t_s: Floats, volts: Floats, seconds: float, period_s: float) -> Floats:
    """Return full loops over the drive's range [actuator volts], no faster than the drive itself,
    to be played before the recording.

    A stage that has rested creeps during the first loops, and a model identified from them is wrong
    for later loops: on the simulated stage, five seconds of exercise reduce the tracking error to a
    third. Empty for 0 seconds or a drive that does not move.
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

    The stage is exercised first (see `exercise`). The drive is interpolated on the loop's sampling
    times; time stamps are measured, a failed reading is NaN, and a late sample is a gap. If `stop`
    returns a reason, or a device fails, recording ends early: the samples so far are returned with
    the reason ("" if the drive was played to its end). Raises DriverError, BadInput, BadRecording;
    also if it ended before the first sample.
    """
    volts = drive * config.actuator.gain
    check_drive(config, t_s, volts)
    period_s = 1.0 / config.loop.rate_hz
    grid = np.arange(t_s[0], t_s[-1], period_s)
    volts_at = np.interp(grid, t_s, volts)[:, None]
    loops = exercise(t_s, volts, exercise_s, period_s)[:, None]
    rows, ended = play_and_record([config], volts_at, loops, progress, stop)
    recording = Recording(
        t_s=rows[:, 0],
        drive=rows[:, 1] / config.actuator.gain,
        displacement=rows[:, 2],
        drive_unit=unit,
        name=f"{config.name} open loop",
    )
    return recording, ended


def play_and_record(
    configs: Sequence[Config],
    volts_at: Floats,
    loops: Floats,
    progress: Callable[[float], None] | None = None,
    stop: Callable[[], str] = str,
) -> tuple[Floats, str]:
    """Write volts_at (N, axes) [actuator volts], one row per period, after loops (M, axes) of
    exercise; the outputs start and end where they were.

    Return rows (n, 1 + 2 axes): time [s], then the voltage in force and the reading of each axis;
    and the reason if it ended early. Raises the same errors as `acquire`.
    """
    rows = np.full((volts_at.shape[0], 1 + 2 * len(configs)), np.nan)
    ended = ""
    try:
        with realtime.raised(configs[0].loop.priority):
            player = _Player(configs, stop, sleeper())
            ended = _run(player, loops, volts_at, rows, progress)
    except DriverError as error:
        if not np.isfinite(rows[:, 0]).any():
            raise
        ended = str(error)
    rows = rows[np.isfinite(rows[:, 0])]
    if not rows.size:
        raise BadRecording(f"nothing was recorded: {ended or 'every sample came too late'}")
    return rows, ended


class _Player(NamedTuple):
    """What playing needs in addition to the devices."""

    configs: Sequence[Config]
    stop: Callable[[], str]
    sleep_until: Callable[[int], object]


class _Links(NamedTuple):
    """Devices of the axes, in order."""

    outputs: list[DrivenOutput]
    sensors: list[DeviceLink]

    def close(self) -> None:
        for link in (*self.sensors, *(output.link for output in self.outputs)):
            link.close()


def _link(configs: Sequence[Config]) -> _Links:
    """Create the devices, not yet opened."""
    links = _Links([], [])
    for config in configs:
        actuator, sensor = config.actuator, config.sensor
        driven = load_actuator(actuator.driver).from_settings(actuator.settings)
        links.outputs.append(DrivenOutput(config, driven))
        read = load_sensor(sensor.driver).from_settings(sensor.settings)
        links.sensors.append(DeviceLink("sensor", read))
    return links


def _run(
    player: _Player,
    loops: Floats,
    volts_at: Floats,
    rows: Floats,
    progress: Callable[[float], None] | None,
) -> str:
    """Fill the rows with time, voltages in force and readings; the outputs end where they were.
    Return the reason if it ended early."""
    configs = player.configs
    links = _link(configs)
    try:
        for output in links.outputs:
            output.open()
        for config, link in zip(configs, links.sensors, strict=True):
            open_known(config, SENSOR, link.device)
        actuators = [output.link.device for output in links.outputs]
        specs = [
            (actuator.spec, sensor.device.spec)
            for actuator, sensor in zip(actuators, links.sensors, strict=True)
        ]
        for config, (spec, _) in zip(configs, specs, strict=True):
            check_limits(config, spec)
        check_rates_together(configs, specs, joined(actuators))
        for output in links.outputs:
            output.find_start()
        ended = ""
        try:
            if loops.size:
                _go_to(links, loops[0])
                unread = np.zeros((loops.shape[0], rows.shape[1]))
                ended = _play(player, links, loops, unread, None)
            if not ended:
                _go_to(links, volts_at[0])
                ended = _play(player, links, volts_at, rows, progress)
        except DriverError as error:
            ended = str(error)
            raise
        finally:
            return_all(links.outputs, ended)  # from their present values, also when interrupted
    finally:
        links.close()
    return ended


def _go_to(links: _Links, volts: Floats) -> None:
    """Ramp one output after the other."""
    for output, goal in zip(links.outputs, volts.tolist(), strict=True):
        output.ramp(goal)


def _play(
    player: _Player,
    links: _Links,
    volts_at: Floats,
    rows: Floats,
    progress: Callable[[float], None] | None,
) -> str:
    """Write volts_at, one row per period; return the reason if it ended early. After a gap, the
    outputs catch up with their drives at the slew limit."""
    period_ns = player.configs[0].period_ns
    most = [config.limits.slew_v_per_s * period_ns * 1e-9 for config in player.configs]
    first = clock.monotonic_ns() + period_ns
    at = volts_at[0].tolist()
    for i, goals in enumerate(volts_at.tolist()):
        if reason := player.stop():
            return reason
        due = first + i * period_ns
        if clock.monotonic_ns() > due + period_ns:
            continue  # too late for this sample: leave a gap, do not catch up in a burst
        player.sleep_until(due)
        time_ns = clock.monotonic_ns()
        readings = [
            _read(config, link) for config, link in zip(player.configs, links.sensors, strict=True)
        ]
        volts = [toward(*step) for step in zip(at, goals, most, strict=True)]
        for output, value in zip(links.outputs, volts, strict=True):
            output.write(value)
        # the readings were taken before this write: they belong to the drive before it
        rows[i, 0] = (time_ns - first) * 1e-9
        rows[i, 1::2], rows[i, 2::2] = at, readings
        at = volts
        if progress is not None and i % 64 == 0:
            progress(i / volts_at.shape[0])
    return ""


def _read(config: Config, link: DeviceLink) -> float:
    """Return a reading [displacement unit]; NaN if it failed."""
    try:
        return float(link.device.read()) * config.sensor.scale + config.sensor.zero
    except DriverError:
        return float("nan")
