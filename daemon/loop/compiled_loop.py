"""The compiled loop: for devices that C can call, from the deadline to the ring without Python.

The same sample as in dehyst.daemon.loop.python_loop: the same kernels, in the same order. It runs
in a thread of its own without the interpreter's lock; the main thread takes signals, brings devices
back, publishes status and events, and talks to the loop through the meter's request fields only.
"""

import threading
from collections.abc import Callable
from typing import Any

import numpy as np
from numba import njit
from numpy.typing import NDArray

from dehyst.daemon import clock
from dehyst.daemon.loop import systemcalls
from dehyst.daemon.loop.devices import DeviceLink
from dehyst.daemon.loop.records_in_memory import CLOCK, NAN, Table, meter_of
from dehyst.daemon.loop.sample import NOT_WRITTEN, REFUSED, WRITTEN, begin, finish
from dehyst.daemon.loop.status import PLACE, LoopMonitor
from dehyst.daemon.loop.step_kernel import stopped
from dehyst.daemon.loop.timing import realtime
from dehyst.daemon.rings.records import Flag
from dehyst.drivers.direct_calls import Direct, Reachable, call, whole_at
from dehyst.models.errors import BadInput

INVALID, HELD = int(Flag.SENSOR_INVALID), int(Flag.SENSOR_HELD)
ATTEND_S = 0.02
SPIN_ABOVE_HZ, SPIN_US = 2000.0, 50.0  # slower loops do not burn a core for their last jitter


@njit(cache=True, nogil=True)
def now_of(table: Table, buffer: NDArray[np.int64]) -> int:
    """CLOCK_MONOTONIC, or the clock that a test put at CLOCK.

    That is (3 + n,) integers: [now ns, ns per look, sleeps so far, lateness of each wake-up ...].
    """
    if table[3 * CLOCK] == 0:
        return systemcalls.read_clock_ns(buffer)
    injected = whole_at(table, CLOCK)
    injected[0] += injected[1]
    return injected[0]


@njit(cache=True, nogil=True)
def sleep_of(table: Table, buffer: NDArray[np.int64], deadline_ns: int, spin_ns: int) -> int:
    """Wait for the deadline, the last spin_ns awake: the time."""
    if table[3 * CLOCK] != 0:
        injected = whole_at(table, CLOCK)
        late = injected[3 + injected[2] % (injected.size - 3)]
        injected[0] = max(injected[0], deadline_ns) + late
        injected[2] += 1
        return injected[0]
    systemcalls.sleep_until_ns(buffer, deadline_ns - spin_ns)
    now = systemcalls.read_clock_ns(buffer)
    if spin_ns > 0 and now >= deadline_ns - spin_ns:
        while now < deadline_ns:
            now = systemcalls.read_clock_ns(buffer)
    return now


@njit(cache=True, nogil=True)
def run_samples(table: Table, samples: int) -> None:
    """Samples until stopped, or so many (-1: no end)."""
    m = meter_of(table)
    buffer, value = np.zeros(32, np.int64), np.zeros(1)
    while samples < 0 or m.samples < samples:
        woke = sleep_of(table, buffer, m.scheduled_ns, m.spin_ns)
        if woke < m.scheduled_ns:
            continue
        flags, io_ns = 0, 0
        if m.sensor_ok == 0:
            m.measured = NAN
            flags = INVALID
        elif m.samples % m.sensor_every != 0:
            flags = HELD
        else:
            before = now_of(table, buffer)
            code = call(m.read, m.read_context, before, value.ctypes.data)
            m.measured = value[0] * m.scale + m.zero
            if code != 0:
                m.measured = NAN
                m.sensor_ok, m.sensor_code = 0, code
            io_ns = now_of(table, buffer) - before
        m.held = 1 if flags == HELD else 0
        volts = begin(table, now_of(table, buffer))
        wrote = NOT_WRITTEN
        if volts == volts:
            before = now_of(table, buffer)
            value[0] = volts
            code = call(m.write, m.write_context, before, value.ctypes.data)
            wrote = WRITTEN
            if code != 0:
                m.actuator_ok, m.actuator_code = 0, code
                wrote = REFUSED
            finished = now_of(table, buffer)
            io_ns += finished - before
        else:
            finished = now_of(table, buffer)
        finish(table, wrote, flags, woke, finished, io_ns)
        if stopped(table, finished):
            break


def warm_up(monitor: LoopMonitor, compiled: bool) -> None:
    """Run every kernel of a sample on a monitor of its own, without its devices.

    Nothing compiles after this, and the code is in memory.
    """
    monitor.numbers[PLACE["actuator_ok"]] = monitor.numbers[PLACE["sensor_ok"]] = 0
    table = monitor.stepper.table
    if compiled:
        table.put(CLOCK, np.array([0, 100, 0, 0]))
        run_samples(table.words, 5)
    for _ in range(5):
        systemcalls.sleeper()(0)
        begin(table.words, 0)
        finish(table.words, NOT_WRITTEN, INVALID, 0, 1, 0)
        stopped(table.words, 0)
    monitor.attend(clock.monotonic_ns())


def direct_of(device: Any) -> Direct | None:
    """How compiled code calls this device; None where only Python does."""
    return device.direct() if isinstance(device, Reachable) else None


def spin_ns(asked_us: float | None, rate_hz: float) -> int:
    """How long the loop waits awake; None: by the rate."""
    if asked_us is None:
        asked_us = SPIN_US if rate_hz > SPIN_ABOVE_HZ else 0.0
    return round(1000 * min(asked_us, 0.5e6 / rate_hz))


class CompiledLoop:
    """Runs a monitor's controller in compiled code. Raises BadInput where a device needs Python.

    enter: called in the loop's thread before the first sample: priority and the like.
    """

    def __init__(
        self, monitor: LoopMonitor, enter: Callable[[], realtime.Obtained] | None = None
    ) -> None:
        self.monitor, self._enter = monitor, enter
        write, read = direct_of(monitor.actuator.device), direct_of(monitor.sensor.device)
        if write is None or read is None:
            raise BadInput(
                "loop.engine = compiled: these drivers are reached through Python only; use "
                'loop.engine = "auto"'
            )
        self._write, self._read = write, read
        m = monitor.meter
        m["write"], m["write_context"] = write.function, write.context
        m["read"], m["read_context"] = read.function, read.context

    def run(self, samples: int | None = None) -> None:
        """Loop until stopped (or for a number of samples); the calling thread attends to it."""
        thread = threading.Thread(target=self._run, args=(samples,), name="loop", daemon=True)
        thread.start()
        while True:
            thread.join(ATTEND_S)
            self._attend()
            if not thread.is_alive():
                break
        self.monitor.attend(clock.monotonic_ns())
        self.monitor.publish_status(clock.monotonic_ns())

    def _run(self, samples: int | None) -> None:
        monitor = self.monitor
        if self._enter is not None:
            monitor.obtained = self._enter()
            monitor.stepper.events.extend(monitor.obtained.advice)
        monitor.meter["schedstat"] = systemcalls.open_schedstat()
        table = monitor.stepper.table.words
        buffer = np.zeros(32, np.int64)
        if monitor.samples == 0:
            monitor.begin(now_of(table, buffer))
        run_samples(table, -1 if samples is None else samples)

    def _attend(self) -> None:
        """Devices that went down or came back, and what is to be said."""
        monitor, numbers = self.monitor, self.monitor.numbers
        if numbers[PLACE["actuator_ok"]] == 0:
            if numbers[PLACE["actuator_code"]] and self._down(monitor.actuator, self._write):
                numbers[PLACE["actuator_code"]] = 0
            elif monitor.actuator.came_back():
                monitor.floats[PLACE["back_v"]] = monitor.actuator.device.output()
                numbers[PLACE["actuator_back"]] = 1
        if numbers[PLACE["sensor_ok"]] == 0:
            if numbers[PLACE["sensor_code"]] and self._down(monitor.sensor, self._read):
                numbers[PLACE["sensor_code"]] = 0
            elif monitor.sensor.came_back():
                numbers[PLACE["sensor_ok"]] = 1
        monitor.attend(clock.monotonic_ns())

    def _down(self, link: DeviceLink, direct: Direct) -> bool:
        kind = "actuator" if link is self.monitor.actuator else "sensor"
        code = int(self.monitor.numbers[PLACE[f"{kind}_code"]])
        link.down(direct.explain(code))
        return True
