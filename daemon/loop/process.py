"""The core process: composition of model, devices, rings and loop. No network.

Start: configuration, model, devices, rates checked, last known output taken over, rings, kernels
warmed, real-time priority, loop. SIGTERM: the output goes to `safe.on_stop`. SIGHUP: the model
is loaded again beside the loop and swapped in without a jump, or refused.
"""

import os
import secrets
from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import NDArray

from dehyst.daemon import clock, notify
from dehyst.daemon.config import Config
from dehyst.daemon.files.chosen import choose_model
from dehyst.daemon.files.models import load_model, write_text
from dehyst.daemon.loop.channels import Channels
from dehyst.daemon.loop.checks import (
    REPLAY_SAMPLES,
    check_limits,
    check_rates,
    devices_of,
    past_output,
)
from dehyst.daemon.loop.compiled_loop import CompiledLoop, direct_of, spin_ns, warm_up
from dehyst.daemon.loop.devices import DeviceLink
from dehyst.daemon.loop.python_loop import PythonLoop
from dehyst.daemon.loop.reach import displacement_range, drive_range, origin
from dehyst.daemon.loop.readback import ReadbackCheck
from dehyst.daemon.loop.settings import LoopSettings
from dehyst.daemon.loop.status import LoopMonitor, Reading
from dehyst.daemon.loop.step import Stepper
from dehyst.daemon.loop.timing import realtime
from dehyst.daemon.loop.timing.witness import Witness
from dehyst.daemon.loop.trim import trim_setting
from dehyst.daemon.rings.records import (
    COMMAND,
    EVENT,
    TELEMETRY,
    Command,
    State,
    model_digest,
    model_file,
)
from dehyst.daemon.rings.ring import Ring
from dehyst.daemon.rings.status import STATUS
from dehyst.models.errors import BadInput, DehystError, NotNow
from dehyst.models.inverse.compensator import Compensator, CompensatorState
from dehyst.models.model import Model
from dehyst.models.modelfile import dumps

RINGS = {"telemetry": (TELEMETRY, 65536), "status": (STATUS, 256), "event": (EVENT, 256)}
COMMAND_RECORDS = 65536
RUN_BITS = 48
EXTEND_US = 15_000_000
KEPT_MODELS = 2  # whoever was told of the one before may still be reading it


Serve = Callable[[Callable[[], None], Callable[[], None]], None]
"""(stop, reload): from now on these are called when the process is asked to end or to reload."""


class Core:
    """One run of the loop's process."""

    def __init__(self, config: Config, serve: Serve) -> None:
        self.config, self._serve = config, serve
        self.model, self._accepted, self._about_model = choose_model(config)
        self.actuator, self.sensor = self._open()

    def _open(self) -> tuple[DeviceLink, DeviceLink]:
        actuator, sensor = devices_of(self.config)
        # drivers measure their rate when they open: at the priority at which the loop will run
        with realtime.raised(self.config.loop.priority):
            actuator.open()
            try:
                sensor.open()
            except BaseException:
                actuator.close()
                raise
        return DeviceLink("actuator", actuator), DeviceLink("sensor", sensor)

    def run(self) -> bool:
        """Until SIGTERM or SIGINT: True when the output stands where safe.on_stop wants it.
        Raises DehystError before anything was moved."""
        try:
            self._run()
            at_end = self.monitor.stepper.volts
            return (
                self.config.safe.on_stop == "hold" or at_end == self.monitor.stepper.settings.safe_v
            )
        finally:
            self.sensor.close()
            self.actuator.close()

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

    def _settings(self, model: Model) -> LoopSettings:
        drives = drive_range(self.config, model)
        low, high = displacement_range(model, *drives)
        zero = origin(self.config.setpoint.origin, low, high)
        slope = (high - low) / (drives[1] - drives[0])
        return LoopSettings.from_config(self.config, zero, self.min_v, self.max_v, slope)

    def _begin_model(self) -> tuple[LoopSettings, Compensator]:
        """What the model is run with; an accepted one that cannot be run makes way."""
        try:
            return self._settings(self.model), self._compensator(self.model)
        except (DehystError, ValueError, ArithmeticError) as error:
            if not self._accepted:
                raise
            self._about_model = f"{self._about_model} cannot be run, the configured one is: {error}"
        self.model, self._accepted = load_model(self.config.model.file), False
        return self._settings(self.model), self._compensator(self.model)

    def _run(self) -> None:
        config = self.config
        actuator, sensor = self.actuator.device, self.sensor.device
        every = check_rates(config, actuator.spec, sensor.spec)
        self.min_v, self.max_v = check_limits(config, actuator.spec)
        settings, compensator = self._begin_model()
        past, doubt = past_output(config, float(actuator.output()))
        volts = float(past[-1])
        stepper = Stepper(settings, compensator, volts, self._trim(self.model))
        channels = Channels(config.channels, stepper.measured, stepper.events.append)
        channels.start()
        stepper.use(compensator, self._led(compensator, past))
        self._tell_model(self.model)
        run = secrets.randbits(RUN_BITS) | 1
        rings = {
            name: Ring.create(config.directory / f"{name}.ring", dtype, size, run)
            for name, (dtype, size) in RINGS.items()
        }
        # the command ring is made last: who finds it finds the others, and a status, complete
        rings["status"].push(self._first_status(settings, volts)[0])
        path = config.directory / "command.ring"
        rings["command"] = Ring.create(path, COMMAND, COMMAND_RECORDS, run)
        self._telemetry = rings["telemetry"]
        monitor = self.monitor = LoopMonitor(
            stepper,
            self.actuator,
            self.sensor,
            rings,
            Reading(config.sensor.scale, config.sensor.zero, every),
            spin_ns(config.loop.spin_us, config.loop.rate_hz),
            self._fill_status,
        )
        runner = self._engine(monitor)
        self._warm(settings, compensator, volts, runner)
        allowed = tuple(sorted(os.sched_getaffinity(0)))
        cpus = (config.loop.cpu,) if config.loop.cpu >= 0 else allowed[:8]
        witness = Witness(config.period_ns, cpus, config.loop.priority, clock.monotonic_ns())
        monitor.use_witness(witness)
        stepper.events.append(
            f"the loop runs: {compensator.mode} inverse ({compensator.reason}), "
            + ("compiled loop" if isinstance(runner, CompiledLoop) else "Python loop")
        )
        if self._about_model:
            stepper.events.append(self._about_model)
        stepper.events.extend(unmeasured(compensator, config))
        stepper.events.extend(doubt)
        if isinstance(runner, PythonLoop):
            monitor.obtained = self._enter()
            stepper.events.extend(monitor.obtained.advice)
        self._serve(monitor.stop, self._reload)
        notify.send("READY=1")
        try:
            runner.run()
        finally:
            notify.send("STOPPING=1")
            witness.close()
            channels.close()

    def _enter(self) -> realtime.Obtained:
        """The calling thread becomes the loop's."""
        return realtime.enter_realtime(
            self.config.loop.priority, self.config.loop.cpu, self.config.loop.rate_hz
        )

    def _engine(self, monitor: LoopMonitor) -> PythonLoop | CompiledLoop:
        """The loop that the configuration and the devices allow."""
        wish = self.config.loop.engine
        reachable = all(
            direct_of(link.device) is not None for link in (monitor.actuator, monitor.sensor)
        )
        if wish == "compiled" or (wish == "auto" and reachable):
            return CompiledLoop(monitor, self._enter)
        tolerance_v = self.config.actuator.readback_tolerance_v
        if not tolerance_v or not hasattr(self.actuator.device, "readback"):
            return PythonLoop(monitor)
        return PythonLoop(monitor, readback=ReadbackCheck(tolerance_v, monitor.stepper.volts))

    def _led(self, compensator: Compensator, volts: NDArray[np.float64]) -> CompensatorState:
        """A compensator's state after the given past."""
        drives = volts / self.config.actuator.gain
        state = compensator.init(float(drives[0]))
        for drive in drives.tolist():
            compensator.applied(state, drive)
        return state

    def _warm(
        self,
        settings: LoopSettings,
        compensator: Compensator,
        volts: float,
        runner: PythonLoop | CompiledLoop,
    ) -> None:
        """Run every kernel of the sample once, so that nothing compiles in the loop."""
        stepper = Stepper(settings, compensator, volts, self._trim(self.model))
        point = np.zeros(2, COMMAND)
        point["kind"], point["trajectory"] = Command.POINT, 1
        point["offset_ns"], point["last"] = (0, 1_000_000), (0, 1)
        single = np.zeros(1, COMMAND)
        single["kind"] = Command.SETPOINT
        for i, commands in enumerate((point, point[:0], single, single, point[:0])):
            record = stepper.step(i * settings.period_ns, 0.0, commands)
            stepper.follow_output(float(record["volts"][0]))
        rings = {
            "command": Ring.scratch(COMMAND, 16),
            "telemetry": Ring.scratch(TELEMETRY, 16),
            "status": Ring.scratch(STATUS, 4),
            "event": Ring.scratch(EVENT, 16),
        }
        monitor = LoopMonitor(stepper, self.actuator, self.sensor, rings)
        warm_up(monitor, isinstance(runner, CompiledLoop))

    def _reload(self) -> None:
        """Load the model file again; keep the old model where the new one is refused."""
        monitor = self.monitor
        try:
            model, accepted, about = choose_model(self.config)
            if (model.drive_unit, model.displacement_unit) != (
                self.model.drive_unit,
                self.model.displacement_unit,
            ):
                raise BadInput("its units are not those of the running model")
            compensator, settings = self._compensator(model), self._settings(model)
            trimmed = self._trim(model)
            ring = self._telemetry
            records, _, _ = ring.read(max(0, ring.head - REPLAY_SAMPLES))
            past = records["volts"] if records.size else np.array([monitor.stepper.volts])
            state = self._led(compensator, past)
        except (DehystError, ValueError, ArithmeticError) as error:
            monitor.stepper.events.append(f"reload refused, the old model stays: {error}")
            return
        # a set-point means the same place before and after, where the stage's owner changed nothing
        same = accepted or (self._accepted and not about)
        about = f" ({about})" if about else ""
        monitor.stepper.events.append(f"model reloaded{about}: {compensator.reason}")
        monitor.stepper.events.extend(unmeasured(compensator, self.config))
        monitor.reload(compensator, state, monitor.stepper.origin if same else settings.origin)
        monitor.stepper.trim_setting[:] = trimmed
        self.model, self._accepted = model, accepted
        try:
            self._tell_model(model)
        except DehystError as error:
            monitor.stepper.events.append(f"clients still see the old model: {error}")

    def _tell_model(self, model: Model) -> None:
        """Leave the model that the loop really uses where the gateway finds it."""
        text = dumps(model)
        path = model_file(self.config.directory, model_digest(text))
        try:
            old = sorted(path.parent.glob("model-*.toml"), key=lambda p: p.stat().st_mtime_ns)
            for file in old[:-KEPT_MODELS]:
                file.unlink()
            write_text(path, text)
        except OSError as error:
            raise NotNow(f"{path}: cannot be written: {error.strerror or error}") from None
        self._told_model = model, model_digest(text)

    def _first_status(self, settings: LoopSettings, volts: float) -> NDArray[Any]:
        """What clients may know before the first sample."""
        status = np.zeros(1, STATUS)
        status["time_ns"], status["wall_ns"] = clock.monotonic_ns(), clock.wall_ns()
        status["state"], status["volts"], status["pid"] = State.START, volts, os.getpid()
        status["origin"], status["period_ns"] = settings.origin, settings.period_ns
        self._fill_model(status, settings.origin)
        return status

    def _fill_model(self, status: NDArray[Any], zero: float) -> None:
        low, high = self._reach()
        status["reach_min"], status["reach_max"] = low - zero, high - zero
        model, digest = self._told_model
        status["unit"], status["drive_unit"] = model.displacement_unit, model.drive_unit
        status["model"] = digest

    def _fill_status(self, status: NDArray[Any]) -> None:
        self._fill_model(status, self.monitor.stepper.origin)
        status["latency_s"] = self.monitor.stepper.compensator.latency_s
        if int(status["state"][0]) == State.STOPPING:
            # systemd waits as long as the ramp takes, whatever TimeoutStopSec= says
            notify.send("WATCHDOG=1", "STOPPING=1", f"EXTEND_TIMEOUT_USEC={EXTEND_US}")
        else:
            notify.send("WATCHDOG=1")

    def _reach(self) -> tuple[float, float]:
        if self.model is not getattr(self, "_reach_of", None):
            self._reach_of = self.model
            self._reach_range = displacement_range(
                self.model, *drive_range(self.config, self.model)
            )
        return self._reach_range


def unmeasured(compensator: Compensator, config: Config) -> list[str]:
    """What to tell of a model whose blocks follow channels that the daemon does not measure."""
    names = ", ".join(name for name in compensator.channels if name not in config.channels)
    return [f"not measured here, so not compensated: {names}"] if names else []


def run_core(config: Config, serve: Serve) -> int:
    """Entry of the core process; exit code."""
    return 0 if Core(config, serve).run() else 1
