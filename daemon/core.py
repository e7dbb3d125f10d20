"""The core process: composition of model, devices, rings and loop. No network.

Start: configuration, model, devices, rates checked, last known output taken over, rings, kernels
warmed, real-time priority, loop. SIGTERM: the output goes to `safe.on_stop`. SIGHUP: the model
is loaded again beside the loop and swapped in without a jump, or refused.
"""

import os
import signal
import threading
from typing import Any

import numpy as np
from numpy.typing import NDArray

from dehyst.daemon import clock, notify, realtime
from dehyst.daemon.channels import Channels
from dehyst.daemon.checks import (
    REPLAY_SAMPLES,
    check_limits,
    check_rates,
    drive_range,
    origin,
    past_output,
    reach,
)
from dehyst.daemon.config import Config
from dehyst.daemon.desk import Desk
from dehyst.daemon.devices import Link
from dehyst.daemon.engine import Engine, direct_of, spin_ns, warm_up
from dehyst.daemon.files import load_model, save_model
from dehyst.daemon.loop import Loop
from dehyst.daemon.readback import ReadbackCheck
from dehyst.daemon.records import COMMAND, EVENT, MODEL_IN_USE, STATUS, TELEMETRY, Command
from dehyst.daemon.ring import Ring
from dehyst.daemon.step import Plan, Stepper
from dehyst.daemon.witness import Witness
from dehyst.drivers.registry import load_actuator, load_sensor
from dehyst.models.compensator import Compensator, CompensatorState
from dehyst.models.errors import BadInput, DehystError
from dehyst.models.model import Model

RINGS = {"telemetry": (TELEMETRY, 65536), "status": (STATUS, 256), "event": (EVENT, 256)}
COMMAND_RECORDS = 65536


class Core:
    """One run of the loop's process."""

    def __init__(self, config: Config) -> None:
        self.config = config
        self.model = load_model(config.model.file)
        self._loading = threading.Lock()
        self.actuator, self.sensor = self._open()

    def _open(self) -> tuple[Link, Link]:
        actuator = load_actuator(self.config.actuator.driver).from_settings(
            self.config.actuator.settings
        )
        sensor = load_sensor(self.config.sensor.driver).from_settings(self.config.sensor.settings)
        # drivers measure their rate when they open: at the priority at which the loop will run
        with realtime.raised(self.config.loop.priority):
            actuator.open()
            try:
                sensor.open()
            except BaseException:
                actuator.close()
                raise
        return Link("actuator", actuator), Link("sensor", sensor)

    def run(self) -> None:
        """Until SIGTERM or SIGINT. Raises DehystError before anything was moved."""
        try:
            self._run()
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

    def _plan(self, model: Model) -> Plan:
        low, high = reach(model, *drive_range(self.config, model))
        return Plan.from_config(
            self.config, origin(self.config.setpoint.origin, low, high), self.min_v, self.max_v
        )

    def _run(self) -> None:
        config = self.config
        actuator, sensor = self.actuator.device, self.sensor.device
        every = check_rates(config, actuator.spec, sensor.spec)
        self.min_v, self.max_v = check_limits(config, actuator.spec)
        plan = self._plan(self.model)
        compensator = self._compensator(self.model)
        past = past_output(config, float(actuator.output()))
        volts = float(past[-1])
        stepper = Stepper(plan, compensator, volts)
        channels = Channels(config.channels, stepper.measured, stepper.events.append)
        channels.start()
        stepper.use(compensator, self._led(compensator, past))
        rings = {
            name: Ring.create(config.directory / f"{name}.ring", dtype, size)
            for name, (dtype, size) in RINGS.items()
        }
        self._tell_model(self.model)
        rings["command"] = Ring.create(config.directory / "command.ring", COMMAND, COMMAND_RECORDS)
        self._telemetry = rings["telemetry"]
        desk = self.desk = Desk(
            stepper, self.actuator, self.sensor, rings, config.sensor.scale, config.sensor.zero,
            every, spin_ns(config.loop.spin_us, config.loop.rate_hz), self._fill_status,
        )  # fmt: skip
        runner = self._engine(desk)
        self._warm(plan, compensator, volts, runner)
        allowed = tuple(sorted(os.sched_getaffinity(0)))
        cpus = (config.loop.cpu,) if config.loop.cpu >= 0 else allowed[:8]
        witness = Witness(config.period_ns, cpus, config.loop.priority, clock.monotonic_ns())
        desk.watch(witness)
        stepper.events.append(
            f"ready: {compensator.mode} inverse ({compensator.reason}), "
            + ("compiled loop" if isinstance(runner, Engine) else "Python loop")
        )
        stepper.events.extend(unmeasured(compensator, config))
        if isinstance(runner, Loop):
            desk.obtained = self._enter()
            stepper.events.extend(desk.obtained.advice)
        signal.signal(signal.SIGTERM, self._on_stop)
        signal.signal(signal.SIGINT, self._on_stop)
        signal.signal(signal.SIGHUP, self._on_reload)
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

    def _engine(self, desk: Desk) -> Loop | Engine:
        """The loop that the configuration and the devices allow."""
        wish = self.config.loop.engine
        reachable = all(direct_of(link.device) is not None for link in (desk.actuator, desk.sensor))
        if wish == "compiled" or (wish == "auto" and reachable):
            return Engine(desk, self._enter)
        tolerance_v = self.config.actuator.readback_tolerance_v
        if not tolerance_v or not hasattr(self.actuator.device, "readback"):
            return Loop(desk)
        return Loop(desk, readback=ReadbackCheck(tolerance_v, desk.stepper.volts))

    def _on_stop(self, *_: Any) -> None:
        self.desk.stop()

    def _on_reload(self, *_: Any) -> None:
        threading.Thread(target=self._reload, name="reload", daemon=True).start()

    def _led(self, compensator: Compensator, volts: NDArray[np.float64]) -> CompensatorState:
        """A compensator's state after the given past."""
        drives = volts / self.config.actuator.gain
        state = compensator.init(float(drives[0]))
        for drive in drives.tolist():
            compensator.applied(state, drive)
        return state

    def _warm(
        self, plan: Plan, compensator: Compensator, volts: float, runner: Loop | Engine
    ) -> None:
        """Run every kernel of the sample once, so that nothing compiles in the loop."""
        stepper = Stepper(plan, compensator, volts)
        point = np.zeros(2, COMMAND)
        point["kind"], point["trajectory"] = Command.POINT, 1
        point["offset_ns"], point["last"] = (0, 1_000_000), (0, 1)
        single = np.zeros(1, COMMAND)
        single["kind"] = Command.SETPOINT
        for i, commands in enumerate((point, point[:0], single, single, point[:0])):
            record = stepper.step(i * plan.period_ns, 0.0, commands)
            stepper.written(float(record["volts"][0]))
        rings = {
            "command": Ring.scratch(COMMAND, 16),
            "telemetry": Ring.scratch(TELEMETRY, 16),
            "status": Ring.scratch(STATUS, 4),
            "event": Ring.scratch(EVENT, 16),
        }
        desk = Desk(stepper, self.actuator, self.sensor, rings)
        warm_up(desk, isinstance(runner, Engine))

    def _reload(self) -> None:
        """Load the model file again; keep the old model where the new one is refused."""
        os.sched_setscheduler(0, os.SCHED_OTHER, os.sched_param(0))
        desk = self.desk
        with self._loading:
            try:
                model = load_model(self.config.model.file)
                if (model.drive_unit, model.displacement_unit) != (
                    self.model.drive_unit, self.model.displacement_unit,
                ):  # fmt: skip
                    raise BadInput("its units are not those of the running model")
                compensator, plan = self._compensator(model), self._plan(model)
                ring = self._telemetry
                records, _, _ = ring.read(max(0, ring.head - REPLAY_SAMPLES))
                past = records["volts"] if records.size else np.array([desk.stepper.volts])
                state = self._led(compensator, past)
            except (DehystError, ValueError, ArithmeticError) as error:
                desk.stepper.events.append(f"reload refused, the old model stays: {error}")
                return
            desk.stepper.events.append(f"model reloaded: {compensator.reason}")
            desk.stepper.events.extend(unmeasured(compensator, self.config))
            desk.reload(compensator, state, plan.origin)
            self.model = model
            try:
                self._tell_model(model)
            except DehystError as error:
                desk.stepper.events.append(f"clients still see the old model: {error}")

    def _tell_model(self, model: Model) -> None:
        """Leave the model that the loop really uses where the gateway finds it."""
        save_model(model, self.config.directory / MODEL_IN_USE)

    def _fill_status(self, status: NDArray[Any]) -> None:
        low, high = self._reach()
        status["reach_min"], status["reach_max"] = low, high
        status["latency_s"] = self.desk.stepper.compensator.latency_s
        notify.send("WATCHDOG=1")

    def _reach(self) -> tuple[float, float]:
        if self.model is not getattr(self, "_reach_of", None):
            self._reach_of = self.model
            self._reach_range = reach(self.model, *drive_range(self.config, self.model))
        zero = self.desk.stepper.origin
        return self._reach_range[0] - zero, self._reach_range[1] - zero


def unmeasured(compensator: Compensator, config: Config) -> list[str]:
    """What to tell of a model whose blocks follow channels that the daemon does not measure."""
    names = ", ".join(name for name in compensator.channels if name not in config.channels)
    return [f"not measured here, so not compensated: {names}"] if names else []


def run_core(config: Config) -> None:
    """Entry of the core process."""
    Core(config).run()
