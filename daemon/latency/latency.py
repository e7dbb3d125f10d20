"""Self-test of `dehyst latency`: run the daemon's own loop on the simulated stage together with the
witness threads, and time the device calls separately."""

import math
import tempfile
import threading
from collections.abc import Callable
from contextlib import closing
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from dehyst.daemon import clock
from dehyst.daemon.config import Config, parse_config
from dehyst.daemon.files.known_units import ACTUATOR, SENSOR, expect_known
from dehyst.daemon.interrupts import ended_at_once
from dehyst.daemon.latency import machine
from dehyst.daemon.loop.checks import SPARE, devices_of
from dehyst.daemon.loop.compiled_loop import CompiledLoop, spin_ns, warm_up
from dehyst.daemon.loop.devices import DeviceLink
from dehyst.daemon.loop.python_loop import PythonLoop
from dehyst.daemon.loop.settings import LoopSettings
from dehyst.daemon.loop.status import LoopMonitor
from dehyst.daemon.loop.step import Stepper
from dehyst.daemon.loop.timing import realtime
from dehyst.daemon.loop.timing.histogram import Histogram
from dehyst.daemon.loop.timing.witness import Witness
from dehyst.daemon.rings.records import COMMAND, EVENT, TELEMETRY, LoopCommand, MissCause
from dehyst.daemon.rings.ring import Ring
from dehyst.daemon.rings.status import STATUS
from dehyst.daemon.service.supervisor import BenchProcess
from dehyst.drivers.registry import load_actuator, load_sensor
from dehyst.drivers.simulated.devices import SimulatedActuator, SimulatedSensor
from dehyst.models.inverse.compensator import Compensator
from dehyst.models.model import Hysteresis, Model, Validity

STALLS = (MissCause.STALL, MissCause.STEAL, MissCause.SUSPENDED, MissCause.PREEMPTED)
IO_S, MOST_CALLS = 2.0, 2000  # how long each device is timed, and at most with how many calls
TOLERATED = 1e-4  # largest share of missed deadlines
FULL_SCALE_V, STROKE_UM = 150.0, 17.0  # of the emulated stage, roughly

CONFIG = """
name = "latency"
model = {{file = "none"}}
actuator = {{driver = "simulated"}}
sensor = {{driver = "simulated"}}
limits = {{min_v = 0.0, max_v = 150.0, slew_v_per_s = 20000.0}}
loop = {{rate_hz = {rate}}}
setpoint = {{stale_s = 3600.0, approach_um_per_s = 200.0}}
"""


@dataclass(frozen=True)
class Setup:
    """Settings of the test. engine: "compiled" or "python"; spin_us: None: chosen by the rate."""

    rate_hz: float = 1000.0
    seconds: float = 30.0
    engine: str = "compiled"
    priority: int = 80
    cpu: int = -1
    spin_us: float | None = None


@dataclass
class LatencyOutcome:
    """Measured figures. Durations in microseconds."""

    setup: Setup
    samples: int = 0
    missed: int = 0
    missed_by: dict[str, int] = field(default_factory=dict)
    wake: Histogram = field(default_factory=Histogram)
    execution: Histogram = field(default_factory=Histogram)
    io: dict[str, Histogram] = field(default_factory=dict)
    obtained: realtime.Obtained = field(
        default_factory=lambda: realtime.Obtained(False, 0, False, ())
    )
    stalls: list[tuple[int, int, MissCause]] = field(default_factory=list)
    stall_threshold_us: float = 0.0
    stall_count: int = 0  # `stalls` holds only the newest

    @property
    def excused(self) -> int:
        """Number of missed deadlines that the witness explains."""
        names = {cause.name.lower() for cause in STALLS}
        return sum(n for name, n in self.missed_by.items() if name in names)

    @property
    def io_us(self) -> float:
        """Duration of the device calls of one sample, 99 % quantile [us]."""
        return sum(h.quantile(0.99) for h in self.io.values())

    @property
    def allowed_hz(self) -> float:
        """Highest rate that the device calls allow [Hz]; infinity if none were timed."""
        busy_us = self.io_us + self.execution.quantile(0.999)
        return SPARE * 1e6 / busy_us if self.io else math.inf

    @property
    def held(self) -> bool:
        """Whether the rate was held, whatever caused the misses, and leaves enough time for the
        device calls."""
        fits = self.io_us + self.execution.quantile(0.999) < 1e6 / self.setup.rate_hz
        tolerated = max(1.0, TOLERATED * self.samples)  # a single miss in few samples says nothing
        return self.samples > 0 and self.missed <= tolerated and fits


def _model() -> Model:
    r = FULL_SCALE_V * (np.arange(16) / 16) ** 1.5 / 2
    b = np.r_[0.09, np.full(15, 0.002)]
    return Model(Hysteresis(r=r, b=b, c=np.array([0.0, 1.0])), Validity(0.0, FULL_SCALE_V))


def _sine(setup: Setup) -> np.ndarray:
    """Return a trajectory for the whole run, so that the inverse is exercised."""
    step_s = max(0.02, setup.seconds / 30_000)
    t_s = np.arange(0.0, setup.seconds + 5.0, step_s)
    points = np.zeros(t_s.size, COMMAND)
    points["kind"], points["trajectory"] = LoopCommand.POINT, 1
    points["offset_ns"] = np.round(t_s * 1e9)
    points["value"] = 0.3 * STROKE_UM * (1.0 - np.cos(2 * np.pi * t_s))
    return points


def _monitor(
    setup: Setup, devices: tuple[DeviceLink, DeviceLink], rings: dict[str, Ring]
) -> LoopMonitor:
    awake_ns = spin_ns(setup.spin_us, setup.rate_hz)
    return LoopMonitor(_stepper(setup.rate_hz), *devices, rings, spin_ns=awake_ns)


def _stepper(rate_hz: float) -> Stepper:
    config = parse_config(CONFIG.format(rate=float(rate_hz)))
    inverse = Compensator(_model(), 1.0 / rate_hz, 0.0, FULL_SCALE_V, 20_000.0)
    return Stepper(LoopSettings.from_config(config, 0.0, 0.0, FULL_SCALE_V, 1.0), inverse, 0.0)


def compile_step() -> None:
    """Compile the single-axis step, which replays recorded runs."""
    _stepper(200.0).step(0, 0.0, np.zeros(0, COMMAND))


def _rings(commands: int) -> dict[str, Ring]:
    sizes = {"telemetry": 4096, "status": 16, "event": 64, "command": commands}
    kinds = {"telemetry": TELEMETRY, "status": STATUS, "event": EVENT, "command": COMMAND}
    return {name: Ring.scratch(kinds[name], size) for name, size in sizes.items()}


def measure(setup: Setup) -> LatencyOutcome:
    """Run the loop on the simulated stage in this process; takes setup.seconds.

    The process keeps its priority and locked memory afterwards.
    """
    name: dict[str, Any] = {"stage": "latency"}
    actuator, sensor = SimulatedActuator.from_settings(name), SimulatedSensor.from_settings(name)
    compiled = setup.engine == "compiled"
    with ended_at_once("dehyst"):  # an interrupt while a kernel loads or is called would be lost
        actuator.open()
        sensor.open()
        links = DeviceLink("actuator", actuator), DeviceLink("sensor", sensor)
        warm_up([_monitor(setup, links, _rings(16))], compiled)
        rings = _rings(32768)
        monitor = _monitor(setup, links, rings)
        rings["command"].push_many(_sine(setup))
    cpus = (setup.cpu,) if setup.cpu >= 0 else machine.usable_cpus()[:8]
    witness = Witness(
        monitor.stepper.settings.period_ns, cpus, setup.priority, clock.monotonic_ns()
    )
    monitor.use_witness(witness)

    def enter() -> realtime.Obtained:
        return realtime.enter_realtime(setup.priority, setup.cpu, setup.rate_hz)

    failures: list[BaseException] = []

    def loop() -> None:
        try:
            if compiled:
                CompiledLoop(monitor, enter).run(samples)
            else:
                monitor.obtained = enter()
                PythonLoop(monitor).run(samples)
        except BaseException as failure:  # raised by the caller
            failures.append(failure)

    samples = max(1, round(setup.seconds * setup.rate_hz))
    # In a separate thread the caller keeps its priority and calls no kernel, where an interrupt
    # would be lost; a daemon thread does not delay the end of an interrupted process.
    thread = threading.Thread(target=loop, name="measured", daemon=True)
    try:
        thread.start()
        thread.join()
    finally:
        witness.close()
    if failures:
        raise failures[0]
    causes = {MissCause(i).name.lower(): int(n) for i, n in enumerate(monitor.missed_by) if n}
    return LatencyOutcome(
        setup,
        monitor.samples,
        monitor.missed,
        causes,
        monitor.wake.whole(),
        monitor.exec.whole(),
        {},
        monitor.obtained,
        witness.seen(),
        witness.threshold_ns * 1e-3,
        witness.count,
    )


def time_calls(call: Callable[[], object]) -> Histogram:
    """Return the durations of a device's calls [us]."""
    histogram, end_ns = Histogram(), clock.monotonic_ns() + round(IO_S * clock.NS)
    for _ in range(MOST_CALLS):
        before_ns = clock.monotonic_ns()
        call()
        after_ns = clock.monotonic_ns()
        histogram.add((after_ns - before_ns) * 1e-3)
        if after_ns > end_ns:
            break
    return histogram


def time_devices(config: Config | None) -> dict[str, Histogram]:
    """Return the durations of the device calls by name [us]: of the configured devices, or of the
    emulated units. No voltage is set on a configured amplifier: its call duration is the one its
    driver determines on opening."""
    if config is not None:
        actuator, sensor = devices_of(config)
        with closing(actuator):
            expect_known(config, ACTUATOR, actuator)
            actuator.open()
            write = Histogram()
            write.add(1e6 / actuator.spec.max_rate_hz)
        with closing(sensor):
            expect_known(config, SENSOR, sensor)
            sensor.open()
            read = time_calls(sensor.read)
        return {f"read {config.sensor.driver}": read, f"write {config.actuator.driver}": write}
    with tempfile.TemporaryDirectory(prefix="dehyst-") as folder:
        bench = BenchProcess(Path(folder), [])
        try:
            gauge = load_sensor("ksg101").from_settings({"port": bench.ports["ksg101"]})
            amplifier = load_actuator("mdt693b").from_settings({"port": bench.ports["mdt693b"]})
            with closing(gauge), closing(amplifier):
                gauge.open()
                amplifier.open()
                volts = amplifier.output()
                return {
                    "read emulated KSG101": time_calls(gauge.read),
                    "write emulated MDT693B": time_calls(lambda: amplifier.write(volts)),
                }
        finally:
            bench.close()
