"""One axis of the core process: its model, devices, stepper, rings and status."""

import os
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from dehyst.daemon import clock
from dehyst.daemon.config import Config
from dehyst.daemon.config.drives import drive_range, implausible_ranges
from dehyst.daemon.files.chosen import choose_model
from dehyst.daemon.files.known_units import ACTUATOR, SENSOR, open_known
from dehyst.daemon.files.models import load_model, write_text
from dehyst.daemon.files.outputs import report_failures
from dehyst.daemon.loop.checks import (
    REPLAY_SAMPLES,
    check_limits,
    devices_of,
    note_output,
    past_output,
)
from dehyst.daemon.loop.devices import DeviceLink
from dehyst.daemon.loop.readback import ReadbackCheck
from dehyst.daemon.loop.records_in_memory import FOLLOW_T
from dehyst.daemon.loop.settings import LoopSettings
from dehyst.daemon.loop.status import LoopMonitor, SensorConversion
from dehyst.daemon.loop.step import Stepper
from dehyst.daemon.loop.trim import trim_setting
from dehyst.daemon.rings.records import COMMAND, EVENT, TELEMETRY, State, model_digest, model_file
from dehyst.daemon.rings.ring import Ring
from dehyst.daemon.rings.run_folder import make_run_folder
from dehyst.daemon.rings.status import STATUS
from dehyst.models.cascade.reach import displacement_range, set_point_origin
from dehyst.models.errors import BadInput, DehystError, NotNow
from dehyst.models.inverse.compensator import Compensator, CompensatorState
from dehyst.models.model import Model
from dehyst.models.modelfile import dumps
from dehyst.models.physics import split_off_one_recording

# numbers of records; those of telemetry are 3 s at the highest rate, for readers that stall
RINGS = {"telemetry": (TELEMETRY, 65536), "status": (STATUS, 256), "event": (EVENT, 256)}
COMMAND_RECORDS = 65536
CATCH_UP = 3  # rounds of reading the samples that arrived while a model was led
KEPT_MODELS = 2  # a reader may still have the previous one open
FOLLOWED = "axis."
"""A model's channel `axis.y` is the displacement of axis y, `axis.y.drive` is its drive."""


@dataclass(frozen=True)
class ChannelSource:
    """Quantity of another axis that a model's channel follows: its drive, or its displacement."""

    axis: str
    drive: bool
    scale: float = 1.0
    zero: float = 0.0


class ReportedModel(NamedTuple):
    """What the status reports of a model. It is replaced as a whole, because one thread fills the
    status and another reloads."""

    digest: str
    unit: str
    drive_unit: str
    reach: tuple[float, float]


def followed_by(config: Config, channels: tuple[str, ...]) -> dict[str, ChannelSource]:
    """Return what an axis' model follows of other axes, by channel: as the configuration binds the
    channel, or by its name."""
    found = {}
    for name in channels:
        bound = config.channels.get(name)
        if bound is not None and bound.axis:
            drive = bound.quantity == "drive"
            found[name] = ChannelSource(bound.axis, drive, bound.scale, bound.zero)
        elif bound is None and name.startswith(FOLLOWED):
            axis, _, quantity = name.removeprefix(FOLLOWED).partition(".")
            if quantity in ("", "drive") and axis != config.axis:
                found[name] = ChannelSource(axis, quantity == "drive")
    return found


def describe_left_out(blocks: Sequence[str]) -> list[str]:
    """Return a message about the model's blocks that describe one recording only; [] without."""
    if not blocks:
        return []
    return [f"blocks of the model that describe one recording only, not run: {', '.join(blocks)}"]


class AxisCore:
    """One axis. Call `open` first, then `begin`, and `prepare` before the loop runs.

    report: called with each status record while it is filled.
    """

    def __init__(self, config: Config, report: Callable[[NDArray[Any]], None]) -> None:
        self.config, self._report = config, report
        model, self._accepted, self._about_model = choose_model(config)
        self.model, self._left_out = split_off_one_recording(model)
        actuator, sensor = devices_of(config)
        self.actuator, self.sensor = DeviceLink("actuator", actuator), DeviceLink("sensor", sensor)
        self._beside: Mapping[str, AxisCore] = {}

    def open(self) -> None:
        """Open the devices. If one cannot be opened, none stays open."""
        open_known(self.config, ACTUATOR, self.actuator.device)
        try:
            open_known(self.config, SENSOR, self.sensor.device)
        except BaseException:
            self.actuator.device.close()
            raise

    def close(self) -> None:
        """Release the devices."""
        self.sensor.close()
        self.actuator.close()

    @property
    def at_rest(self) -> bool:
        """Return True when the output is where safe.on_stop requires it."""
        stepper = self.monitor.stepper
        return self.config.safe.on_stop == "hold" or stepper.volts == stepper.settings.safe_v

    # -- before the loop ------------------------------------------------------------------------

    def begin(self) -> None:
        """Determine limits, model and present output, and make the stepper."""
        config, actuator = self.config, self.actuator.device
        self.min_v, self.max_v = check_limits(config, actuator.spec)
        self._settings, self._first = self._begin_model()
        past, self._doubt = past_output(config, float(actuator.output()), actuator)
        self.stepper = Stepper(self._settings, self._first, float(past[-1]), self._trim(self.model))
        self._past = past

    def prepare(self, beside: Mapping[str, "AxisCore"], run: int, every: int, spin_ns: int) -> None:
        """Make the rings and the monitor. beside: all axes by name; run: number of this run;
        every: the sensor is read every n-th sample; spin_ns: busy wait before a deadline."""
        config, stepper, compensator = self.config, self.stepper, self._first
        self._beside = beside
        stepper.use(compensator, self._led(compensator, self._past))
        stepper.follow(self._rows(compensator))
        make_run_folder(config.directory)
        self._reported = self._reported_model(self.model, self._leave_model(self.model))
        note_output(config, float(self._past[-1]))  # a start may end before the first record
        rings = {
            name: Ring.create(config.directory / f"{name}.ring", dtype, size, run)
            for name, (dtype, size) in RINGS.items()
        }
        # the command ring is made last: when it exists, the others and a status are complete
        rings["status"].push(self._first_status()[0])
        path = config.directory / "command.ring"
        rings["command"] = Ring.create(path, COMMAND, COMMAND_RECORDS, run)
        self._telemetry = rings["telemetry"]
        self.monitor = LoopMonitor(
            stepper,
            self.actuator,
            self.sensor,
            rings,
            SensorConversion(config.sensor.scale, config.sensor.zero, every),
            spin_ns,
            self._fill_status,
        )

    def say_how(self, loop: str) -> None:
        """Add the first events: what runs, and what is wrong. loop: name of the loop's kind."""
        compensator, events = self._first, self.stepper.events
        events.append(f"the loop runs: {compensator.mode} inverse ({compensator.reason}), {loop}")
        if self._about_model:
            events.append(self._about_model)
        events.extend(self._about(self.model, self._left_out, compensator))
        events.extend(self._doubt)

    def readback_check(self) -> ReadbackCheck | None:
        """Return the slow check of the amplifier's report; None where it is not possible."""
        tolerance_v = self.config.actuator.readback_tolerance_v
        if not tolerance_v or not hasattr(self.actuator.device, "readback"):
            return None
        return ReadbackCheck(tolerance_v, self.stepper.volts)

    def twin(self) -> LoopMonitor:
        """Return a separate monitor of the same kind, without files, for warming up."""
        stepper = Stepper(self._settings, self._first, self.stepper.volts, self._trim(self.model))
        rings = {
            "command": Ring.scratch(COMMAND, 16),
            "telemetry": Ring.scratch(TELEMETRY, 16),
            "status": Ring.scratch(STATUS, 4),
            "event": Ring.scratch(EVENT, 16),
        }
        return LoopMonitor(stepper, self.actuator, self.sensor, rings)

    # -- models -----------------------------------------------------------------------------------

    def _compensator(self, model: Model) -> Compensator:
        config, gain = self.config, self.config.actuator.gain
        return Compensator(
            model,
            config.period_ns * 1e-9,
            self.min_v / gain,
            self.max_v / gain,
            config.limits.slew_v_per_s / gain,
            config.inverse.mode,
            config.inverse.preview_s,
        )

    def _trim(self, model: Model) -> NDArray[Any]:
        low, high = displacement_range(model, *drive_range(self.config, model))
        return trim_setting(self.config, model, high - low, self.sensor.device.spec)

    def _loop_settings(self, model: Model) -> LoopSettings:
        drives = drive_range(self.config, model)
        low, high = displacement_range(model, *drives)
        zero = set_point_origin(self.config.setpoint.origin, model, *drives)
        slope = (high - low) / (drives[1] - drives[0])
        return LoopSettings.from_config(self.config, zero, self.min_v, self.max_v, slope)

    def _begin_model(self) -> tuple[LoopSettings, Compensator]:
        """Return the model's settings and compensator. An accepted model that cannot be run is
        replaced by the configured one."""
        try:
            return self._loop_settings(self.model), self._compensator(self.model)
        except (DehystError, ValueError, ArithmeticError) as error:
            if not self._accepted:
                raise
            self._about_model = (
                f"{self._about_model} cannot be run, so the configured one is used: {error}"
            )
        configured, self._accepted = load_model(self.config.model.file), False
        self.model, self._left_out = split_off_one_recording(configured)
        return self._loop_settings(self.model), self._compensator(self.model)

    def _led(self, compensator: Compensator, volts: NDArray[np.float64]) -> CompensatorState:
        """Return a compensator's state after the voltages of the past."""
        state = compensator.init(float(volts[0]) / self.config.actuator.gain)
        return self._led_on(compensator, state, volts)

    def _led_on(
        self, compensator: Compensator, state: CompensatorState, volts: NDArray[np.float64]
    ) -> CompensatorState:
        for drive in (volts / self.config.actuator.gain).tolist():
            compensator.applied(state, drive)
        return state

    def followed(self, compensator: Compensator) -> dict[str, ChannelSource]:
        """Return what this model follows of existing axes, by channel."""
        found = followed_by(self.config, compensator.channels)
        return {name: what for name, what in found.items() if what.axis in self._beside}

    def _rows(self, compensator: Compensator) -> NDArray[Any]:
        followed = self.followed(compensator)
        rows = np.zeros(len(followed), FOLLOW_T)
        for row, (name, what) in zip(rows, followed.items(), strict=True):
            row["channel"] = compensator.channels.index(name)
            row["axis"] = self._beside[what.axis].stepper.table.address
            row["drive"], row["scale"], row["zero"] = what.drive, what.scale, what.zero
        return rows

    def _about(self, model: Model, left_out: Sequence[str], compensator: Compensator) -> list[str]:
        """Return messages about what a model lacks, or may lack, on this stage."""
        said = implausible_ranges(self.config, model)
        return [*said, *describe_left_out(left_out), *self.unmeasured(compensator)]

    def unmeasured(self, compensator: Compensator) -> list[str]:
        """Return messages about channels that are neither measured nor followed."""
        measured = {name for name, channel in self.config.channels.items() if channel.driver}
        known = measured | self.followed(compensator).keys()
        names = ", ".join(name for name in compensator.channels if name not in known)
        return [f"not measured here, so not compensated: {names}"] if names else []

    def reload(self) -> None:
        """Load the model file again; keep the old model where the new one is refused."""
        monitor = self.monitor
        try:
            chosen, accepted, about = choose_model(self.config)
            model, left_out = split_off_one_recording(chosen)
            if (model.drive_unit, model.displacement_unit) != (
                self.model.drive_unit,
                self.model.displacement_unit,
            ):
                raise BadInput("its units are not those of the running model")
            compensator, settings = self._compensator(model), self._loop_settings(model)
            trimmed = self._trim(model)
            ring = self._telemetry
            records, seen, _ = ring.read(max(0, ring.head - REPLAY_SAMPLES))
            past = records["volts"] if records.size else np.array([monitor.stepper.volts])
            state = self._led(compensator, past)
            for _ in range(CATCH_UP):
                records, seen, _ = ring.read(seen)
                self._led_on(compensator, state, records["volts"])
        except (DehystError, ValueError, ArithmeticError) as error:
            monitor.stepper.events.append(f"reload refused; the old model stays in use: {error}")
            return
        # a set-point keeps its position, unless the stage's owner changed the model
        same = accepted or (self._accepted and not about)
        about = f" ({about})" if about else ""
        monitor.stepper.events.append(f"model reloaded{about}: {compensator.reason}")
        monitor.stepper.events.extend(self._about(model, left_out, compensator))
        zero = monitor.stepper.origin if same else settings.origin
        digest = self._reported.digest
        try:
            digest = self._leave_model(model)
        except DehystError as error:
            monitor.stepper.events.append(f"clients still see the old model: {error}")
        reported = self._reported_model(model, digest)
        monitor.reload(compensator, state, zero, self._rows(compensator))
        monitor.stepper.trim_setting[:] = trimmed
        self.model, self._accepted, self._reported = model, accepted, reported

    def _leave_model(self, model: Model) -> str:
        """Write the model that the loop uses to a file for the gateway; return its digest."""
        text = dumps(model)
        digest = model_digest(text)
        path = model_file(self.config.directory, digest)
        with report_failures(path, NotNow):
            old = sorted(path.parent.glob("model-*.toml"), key=lambda p: p.stat().st_mtime_ns)
            for file in old[:-KEPT_MODELS]:
                file.unlink()
            write_text(path, text)
        return digest

    def _reported_model(self, model: Model, digest: str) -> ReportedModel:
        reach = displacement_range(model, *drive_range(self.config, model))
        return ReportedModel(digest, model.displacement_unit, model.drive_unit, reach)

    # -- status -----------------------------------------------------------------------------------

    def _first_status(self) -> NDArray[Any]:
        """Return the status for clients before the first sample."""
        settings, status = self._settings, np.zeros(1, STATUS)
        status["time_ns"], status["wall_ns"] = clock.monotonic_ns(), clock.wall_ns()
        status["state"], status["volts"] = State.START, self.stepper.volts
        status["pid"] = os.getpid()
        status["origin"], status["period_ns"] = settings.origin, settings.period_ns
        self._fill_model(status, settings.origin)
        return status

    def _fill_model(self, status: NDArray[Any], zero: float) -> None:
        reported = self._reported
        low, high = reported.reach
        status["reach_min"], status["reach_max"] = low - zero, high - zero
        status["unit"], status["drive_unit"] = reported.unit, reported.drive_unit
        status["model"] = reported.digest

    def _fill_status(self, status: NDArray[Any]) -> None:
        self._fill_model(status, self.monitor.stepper.origin)
        status["latency_s"] = self.monitor.stepper.compensator.latency_s
        self._report(status)
        for end in ("reach_min", "reach_max"):  # a target is trimmed before it is inverted
            status[end] -= status["trim"]
