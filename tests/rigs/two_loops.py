"""A controller in virtual time, run by either engine in this process; on the simulated stage unless
a test passes other devices."""

import weakref
from collections.abc import Iterable
from typing import Any

import numpy as np

from dehyst.daemon.config import parse_config
from dehyst.daemon.loop import records_in_memory
from dehyst.daemon.loop.compiled_loop import CompiledLoop
from dehyst.daemon.loop.devices import DeviceLink
from dehyst.daemon.loop.python_loop import PythonLoop
from dehyst.daemon.loop.settings import LoopSettings
from dehyst.daemon.loop.status import PLACE, LoopMonitor
from dehyst.daemon.loop.step import Stepper
from dehyst.daemon.rings.records import COMMAND, EVENT, TELEMETRY, LoopCommand
from dehyst.daemon.rings.ring import Ring
from dehyst.daemon.rings.status import STATUS
from dehyst.drivers.simulated.devices import SimulatedActuator, SimulatedSensor
from dehyst.models.inverse.compensator import Compensator
from dehyst.models.model import Block, Hysteresis, Model, Validity

PERIOD_NS = 1_000_000
LOOK_NS = 700  # cost of one clock reading in virtual time
CONFIG = """
name = "two"
[model]
file = "none"
[actuator]
driver = "simulated"
[sensor]
driver = "simulated"
[limits]
min_v = 0
max_v = 150
slew_v_per_s = 4000
[safe]
voltage_v = 5.0
ramp_v_per_s = 400.0
on_fault = "ramp"
[setpoint]
stale_s = 0.1
hold_s = 0.05
approach_um_per_s = 200.0
"""


def model(tau_s: float = 0.0, blocks: tuple[Block, ...] = ()) -> Model:
    r = 150 * (np.arange(8) / 8) ** 2 / 2
    b = np.r_[0.08, np.full(7, 0.005)]
    k = b * tau_s
    return Model(Hysteresis(r=r, b=b, c=[0.0, 1.0], k=k), Validity(0.0, 150.0), blocks=blocks)


def setpoint(um: float) -> np.ndarray:
    """Return one command: go to this displacement."""
    batch = np.zeros(1, COMMAND)
    batch["kind"], batch["value"] = LoopCommand.SETPOINT, um
    return batch


class VirtualClock:
    """A clock that advances by LOOK_NS per reading and wakes sleepers late by a given pattern."""

    def __init__(self, lateness_ns: Iterable[int]) -> None:
        self.cell = np.zeros(1, np.int64)  # the time, where a C device can read it
        self._late, self._sleeps = list(lateness_ns), 0

    @property
    def now_ns(self) -> int:
        return int(self.cell[0])

    @now_ns.setter
    def now_ns(self, value: int) -> None:
        self.cell[0] = value

    def now(self) -> int:
        self.now_ns += LOOK_NS
        return self.now_ns

    def sleep_until(self, deadline_ns: int) -> int:
        late = self._late[self._sleeps % len(self._late)]
        self._sleeps += 1
        self.now_ns = max(self.now_ns, deadline_ns) + late
        return self.now_ns

    def words(self) -> np.ndarray:
        """Return the same clock for the compiled engine."""
        return np.array([self.now_ns, LOOK_NS, 0, *self._late])


_links: "weakref.WeakSet[DeviceLink]" = weakref.WeakSet()


def end_links() -> None:
    """Close the devices of every rig, so that no thread reconnects a device of the next test."""
    for link in list(_links):
        link.close()
    _links.clear()


class Rig:
    """One controller; `play` runs it over batches of commands with either engine.

    devices: actuator and sensor, open; None: a simulated stage of this name, then in `stage`.
    """

    def __init__(
        self,
        name: str,
        mode: str = "static",
        lateness_ns: Iterable[int] = (5000,),
        devices: tuple[Any, Any] | None = None,
        blocks: tuple[Block, ...] = (),
        origin: float = 0.0,
        period_ns: int = PERIOD_NS,
    ):
        if devices is None:
            settings: dict[str, Any] = {"stage": name, "period_s": period_ns * 1e-9}
            simulated = SimulatedActuator.from_settings(settings)
            devices = simulated, SimulatedSensor.from_settings(settings)
            self.stage = simulated.shared
            for device in devices:
                device.open()
        actuator, sensor = devices
        compensator = Compensator(
            model(0.0 if mode == "static" else 2e-5, blocks), period_ns * 1e-9, 0.0, 150.0, 4000.0,
            mode, 0.02,
        )  # fmt: skip
        settings = LoopSettings.from_config(
            parse_config(CONFIG + f"[loop]\nrate_hz = {1e9 / period_ns}\n"), origin, 0.0, 150.0, 0.1
        )
        self.stepper = Stepper(settings, compensator, 0.0)
        self.rings = {
            name: Ring.scratch(dtype, size)
            for name, dtype, size in (
                ("telemetry", TELEMETRY, 8192), ("status", STATUS, 64), ("event", EVENT, 64),
                ("command", COMMAND, 4096),
            )
        }  # fmt: skip
        links = DeviceLink("actuator", actuator), DeviceLink("sensor", sensor)
        _links.update(links)
        self.monitor = LoopMonitor(self.stepper, *links, self.rings)
        self.clock = VirtualClock(lateness_ns)
        self.words = self.clock.words()

    def play(self, batches: list[np.ndarray], samples_each: int, compiled: bool) -> np.ndarray:
        """Push each batch and run this many samples after it; return all telemetry records."""
        total = self.monitor.samples
        if compiled:
            runner: CompiledLoop | PythonLoop = CompiledLoop(self.monitor)
            self.stepper.table.put(records_in_memory.CLOCK, self.words)
        else:
            runner = PythonLoop(self.monitor, self.clock.now, self.clock.sleep_until)
        for batch in batches:
            self.rings["command"].push_many(batch)
            total += samples_each
            runner.run(total)
        return self.rings["telemetry"].read(0)[0]

    @property
    def scheduled_ns(self) -> int:
        return int(self.monitor.numbers[PLACE["scheduled_ns"]])
