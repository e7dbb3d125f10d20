"""Checks before a voltage moves: ranges, rates, and the last known output.

Nothing here needs the compiler, because `dehyst safe` must run when nothing else does.
"""

import math
import os
from collections.abc import Sequence
from contextlib import suppress
from typing import Any

import numpy as np
from numpy.typing import NDArray

from dehyst.daemon.config import Config
from dehyst.daemon.files.models import write_text
from dehyst.daemon.input_file import NotReadable, read_text
from dehyst.daemon.rings.records import TELEMETRY
from dehyst.daemon.rings.ring_file import RingFile
from dehyst.daemon.rings.run_folder import make_run_folder
from dehyst.drivers import system
from dehyst.drivers.interface import (
    Actuator,
    DeviceSpec,
    ForeignUnit,
    Identifiable,
    Joinable,
    Joint,
    Sensor,
)
from dehyst.drivers.registry import load_actuator, load_sensor
from dehyst.models.errors import BadInput, DehystError

REPLAY_SAMPLES = 20_000  # newest ones, read at a start: the last 20 s at 1 kHz
LAST, LEFT, LONGEST_NOTE = "telemetry.ring", "output-left", 200
"""Files of an axis' run folder: LAST is the ring of what its core wrote; LEFT notes an output that
this ring lacks, as "RUN HEAD VOLTS". RUN (of the ring's writer) and HEAD (number of records) name
the place in the ring at which the note was made; they are 0 without a ring. A ring that has left
this place is newer than the note. Unlike a time, a place stays valid after a boot."""
OUTPUT_AGREES_V = 1.0  # an MDT693B's readback is off by up to 0.3 V
SPARE = 0.8  # part of the period that device calls may take
OFFERED = 0.5  # the same at a suggested rate: it leaves room for a report of the amplifier and a
# reply later than those that were timed (tests/benchmarks/daemon/deadlines_of_axes.py)
REPORT_SPARE = 0.95  # the same in a sample that queries the amplifier for its output


def devices_of(config: Config) -> tuple[Actuator, Sensor]:
    """Return the configured drivers, made from their settings but not opened: no device is touched.
    Raises DriverConfigError for a wrong driver name or setting."""
    actuator = load_actuator(config.actuator.driver).from_settings(config.actuator.settings)
    return actuator, load_sensor(config.sensor.driver).from_settings(config.sensor.settings)


def check_unopened(config: Config) -> None:
    """Check the devices as far as possible before one is touched: drivers, their settings, and
    limits and rates against what the drivers know of their units. Raises BadInput or
    DriverConfigError."""
    actuator, _ = devices_of(config)
    for channel in config.channels.values():
        if channel.driver:
            load_sensor(channel.driver).from_settings(channel.settings)
    spec = getattr(actuator, "spec", None)  # some drivers know it only when they are open
    if spec is None:
        return
    check_limits(config, spec)
    if config.loop.rate_hz > spec.max_rate_hz:
        raise BadInput(
            f"loop.rate_hz = {config.loop.rate_hz:g}: {config.actuator.driver} is known to sustain "
            f"{spec.max_rate_hz:.0f} Hz; set loop.rate_hz to {_round_down(spec.max_rate_hz):g} or "
            "less, or drive the stage through an analog input"
        )


Specs = Sequence[tuple[DeviceSpec, DeviceSpec]]
"""(actuator, sensor) of each axis."""
Joints = Sequence[tuple[Joint, tuple[int, ...]]]
"""Result of `joined`."""


def check_rates(config: Config, actuator: DeviceSpec, sensor: DeviceSpec) -> int:
    """Return n: the sensor is read every n-th sample. Raises BadInput if the loop is too fast."""
    rate = config.loop.rate_hz
    if rate > actuator.max_rate_hz:
        raise BadInput(
            f"loop.rate_hz = {rate:g}: actuator {config.actuator.driver} sustains "
            f"{actuator.max_rate_hz:.0f} Hz as measured on this unit; set loop.rate_hz to "
            f"{offered_hz([(actuator, sensor)], []):g} or less, or drive the stage through an "
            f"analog input"
        )
    return max(1, math.ceil(rate / sensor.max_rate_hz))


def check_rates_together(configs: Sequence[Config], specs: Specs, joints: Joints) -> list[int]:
    """Return for each axis n: its sensor is read every n-th sample. Raises BadInput where the loop
    is too fast for all of them in one period; the suggested rate leaves room for late replies."""
    rate, every = configs[0].loop.rate_hz, []
    for joint, places in joints:
        driven = slowest_number(joint, places)
        sustained = joint.rate_hz(driven)
        if rate > sustained:
            names = ", ".join(configs[i].axis for i in places)
            raise BadInput(
                f"loop.rate_hz = {rate:g}: the amplifier of the axes {names} sustains "
                f"{sustained:.0f} Hz with {driven} of them driven, as measured on this unit; set "
                f"loop.rate_hz to {offered_hz(specs, joints):g} or less"
            )
    for config, (actuator, sensor) in zip(configs, specs, strict=True):
        try:
            every.append(check_rates(config, actuator, sensor))
        except BadInput as error:
            where = f"axis {config.axis}: " if len(configs) > 1 else ""
            raise BadInput(f"{where}{error}") from None
    io_s = calls_s(specs, joints, late=False)
    if io_s * rate > SPARE:
        whose = f"the device calls of {len(configs)} axes" if len(configs) > 1 else "device calls"
        raise BadInput(
            f"loop.rate_hz = {rate:g}: {whose} take {io_s * 1e3:.2f} ms of the {1e3 / rate:.2f} ms "
            f"period; set loop.rate_hz to {offered_hz(specs, joints):g} or less"
        )
    return every


def about_late_replies(rate_hz: float, specs: Specs, joints: Joints) -> list[str]:
    """Return a warning about a rate that is sustained but leaves no room for late replies."""
    io_s = calls_s(specs, joints, late=True)
    if io_s * rate_hz <= SPARE:
        return []
    return [
        f"loop.rate_hz = {rate_hz:g}: late device calls take {io_s * 1e3:.2f} ms of the "
        f"{1e3 / rate_hz:.2f} ms period and will cost deadlines now and then; "
        f"{offered_hz(specs, joints):g} Hz or less leave room for them"
    ]


def slowest_number(joint: Joint, places: tuple[int, ...]) -> int:
    """Return the number of driven outputs for which setting an amplifier takes longest."""
    return min(range(1, len(places) + 1), key=joint.rate_hz)


def calls_s(specs: Specs, joints: Joints, late: bool) -> float:
    """Return the duration of a sample's device calls [s], usual or late."""
    alone, spent_s = set(range(len(specs))), 0.0
    for joint, places in joints:
        alone -= set(places)
        driven = slowest_number(joint, places)
        spent_s += joint.late_s(driven) if late else 1.0 / joint.rate_hz(driven)
    for i, (actuator, sensor) in enumerate(specs):
        sets_s = actuator.call_s if late else actuator.latency_s
        spent_s += sets_s if i in alone else 0.0
        spent_s += sensor.call_s if late else sensor.latency_s
    return spent_s


def offered_hz(specs: Specs, joints: Joints) -> float:
    """Return the highest rate [Hz], to two digits, that leaves room for late replies."""
    highest = min(actuator.max_rate_hz for actuator, _ in specs)
    return _round_down(min(highest, OFFERED / calls_s(specs, joints, late=True)))


def crowded(period_s: float, specs: Specs, joints: Joints) -> dict[int, tuple[int, ...]]:
    """Return the axes whose amplifier cannot be queried for its output in a sample that also sets
    outputs: (index of the axis: indices of all outputs of that amplifier)."""
    together = {place: places for _, places in joints for place in places}
    io_s = calls_s(specs, joints, late=True)
    return {
        i: together.get(i, (i,))
        for i, (actuator, sensor) in enumerate(specs)
        if io_s - sensor.call_s + actuator.call_s > REPORT_SPARE * period_s
    }


def joined(actuators: Sequence[Actuator]) -> list[tuple[Joint, tuple[int, ...]]]:
    """Return which of these open outputs belong to one amplifier, by index; single outputs are left
    out."""
    units: dict[tuple[type, str], list[int]] = {}
    for place, actuator in enumerate(actuators):
        if isinstance(actuator, Joinable):
            units.setdefault((type(actuator), actuator.unit_key), []).append(place)
    found = []
    for places in units.values():
        if len(places) > 1:
            first, *others = [actuators[place] for place in places]
            assert isinstance(first, Joinable)
            found.append((first.join(others), tuple(places)))
    return found


def highest_rate(specs: Specs, joints: Joints) -> float:
    """Return the highest loop rate [Hz], to two digits, that leaves these units room for late
    replies with the sensors read in every sample. specs, joints: as for `check_rates_together`."""
    slowest = min(sensor.max_rate_hz for _, sensor in specs)
    return min(offered_hz(specs, joints), _round_down(slowest))


def _round_down(rate_hz: float) -> float:
    """Round a rate down to two digits."""
    step = 10.0 ** (math.floor(math.log10(rate_hz)) - 1)
    return step * math.floor(rate_hz / step)


def check_limits(config: Config, spec: DeviceSpec) -> tuple[float, float]:
    """Return the voltage range of this run. Raises BadInput where it exceeds the unit's range."""
    limits = config.limits
    if limits.min_v < spec.minimum or limits.max_v > spec.maximum:
        raise BadInput(
            f"limits {limits.min_v:g} to {limits.max_v:g} V are wider than the unit's own "
            f"{spec.minimum:g} to {spec.maximum:g} V ({spec.identity or config.actuator.driver})"
        )
    return limits.min_v, limits.max_v


def note_output(config: Config, volts: float) -> None:
    """Note an output [V] that the ring does not record: `dehyst safe` has written it, or the ring
    is about to be replaced. Only the process that drives the output calls this. A run folder that
    cannot be written keeps no output from its safe state, so errors are ignored."""
    run = head = 0
    with suppress(BadInput), RingFile(config.directory / LAST, TELEMETRY) as ring:
        run, head = ring.run, ring.place()[0]
    with suppress(DehystError, OSError):
        make_run_folder(config.directory)
        write_text(config.directory / LEFT, f"{run} {head} {volts!r}\n")


def _noted_output(config: Config, run: int, head: int) -> list[float]:
    """Return the noted output, [volts], or [] if none is noted or the ring, which is at this place,
    has recorded samples since. A ring without records was made after the note."""
    path = config.directory / LEFT
    try:
        if os.lstat(path).st_uid != system.user_id():
            return []
        words = read_text(path, LONGEST_NOTE).split()
        place, volts = (int(words[0]), int(words[1])), float(words[2])
    except (OSError, NotReadable, ValueError, IndexError):
        return []
    newest = head == 0 or place == (run, head)
    return [volts] if newest and math.isfinite(volts) else []


def past_output(
    config: Config, reported_v: float, actuator: Any = None
) -> tuple[NDArray[np.float64], list[str]]:
    """Return the voltages written so far, oldest first and ending with the present output; and
    messages about them.

    The ring of an earlier core, with the output noted since, is more accurate than the unit's own
    report. It is used where the two agree or the unit cannot report; otherwise the report alone is
    returned. actuator: the open device; where its unit has no serial number, a report that
    disagrees raises ForeignUnit, because it may be another unit.
    """
    reported, path = np.array([reported_v]), config.directory / LAST
    volts, run, head = np.empty(0), 0, 0
    if path.exists():
        try:
            with RingFile(path, TELEMETRY) as ring:
                run, head = ring.run, ring.place()[0]
                records, _ = ring.read(max(0, head - REPLAY_SAMPLES))
        except BadInput as error:
            return reported, [f"the voltages written before are not known: {error}"]
        volts = np.array(records["volts"], dtype=np.float64)
    volts = np.append(volts, _noted_output(config, run, head))
    inside = (volts >= config.limits.min_v) & (volts <= config.limits.max_v)
    agrees = volts.size and abs(volts[-1] - reported_v) <= OUTPUT_AGREES_V
    asked = actuator is None or actuator.spec.output_known
    if volts.size and inside.all() and (agrees or not asked):
        return volts, []
    unit = actuator.unit if isinstance(actuator, Identifiable) else None
    step_v = config.limits.slew_v_per_s * config.period_ns * 1e-9  # written, but not recorded yet
    if unit is None or unit.serial or not volts.size:
        return reported, []
    if abs(volts[-1] - reported_v) > OUTPUT_AGREES_V + step_v:
        raise ForeignUnit(
            f"a unit without a serial number is at {reported_v:.2f} V, but the output was left at "
            f"{volts[-1]:.2f} V; it may be another unit, or was moved by hand, so nothing was set "
            "on it. `dehyst config pin` accepts it as it is"
        )
    return reported, []
