"""The compiled loop, for devices that C can call: no Python from the deadline to the ring.

A sample is the same as in dehyst.daemon.loop.python_loop: the same kernels in the same order. It
runs in its own thread without the interpreter's lock; the main thread handles signals, reconnects
devices, publishes status and events, and passes requests to the loop only through the meter's
request fields.
"""

import threading
from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
from numba import njit
from numpy.typing import NDArray

from dehyst.daemon import clock
from dehyst.daemon.loop import systemcalls
from dehyst.daemon.loop.axes.kernels import axis_at, begin_axes
from dehyst.daemon.loop.devices import DeviceLink
from dehyst.daemon.loop.records_in_memory import CLOCK, NAN, Table, meter_of
from dehyst.daemon.loop.sample import NOT_TAKEN, NOT_WRITTEN, WRITTEN, finish
from dehyst.daemon.loop.status import PLACE, LoopMonitor, addresses_of, begin_together
from dehyst.daemon.loop.step_kernel import stopped
from dehyst.daemon.loop.timing import realtime
from dehyst.daemon.rings.records import COMMAND, Flag, LoopCommand
from dehyst.drivers.direct_calls import Direct, Reachable, call
from dehyst.models.addresses import whole_at
from dehyst.models.errors import BadInput

INVALID, HELD = int(Flag.SENSOR_INVALID), int(Flag.SENSOR_HELD)
ATTEND_S = 0.02
SPIN_ABOVE_HZ, SPIN_US = 2000.0, 50.0  # slower loops do not occupy a core to reduce jitter


@njit(cache=True, nogil=True)
def now_of(table: Table, buffer: NDArray[np.int64]) -> int:
    """Return CLOCK_MONOTONIC [ns], or the time of the clock that a test put at CLOCK.

    That clock is (3 + n,) integers: [now ns, ns per call, number of sleeps, lateness of each
    wake-up ...].
    """
    if table[3 * CLOCK] == 0:
        return systemcalls.read_clock_ns(buffer)
    injected = whole_at(table, CLOCK)
    injected[0] += injected[1]
    return injected[0]


@njit(cache=True, nogil=True)
def sleep_of(table: Table, buffer: NDArray[np.int64], deadline_ns: int, spin_ns: int) -> int:
    """Wait for the deadline, the last spin_ns busy; return the time [ns]."""
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
def read_gauge(table: Table, clock: Table, buffer: NDArray[np.int64]) -> tuple[int, int]:
    """Read an axis' sensor into its meter; return (flags, time in the driver [ns])."""
    m, value = meter_of(table), np.zeros(1)
    flags, io_ns = 0, 0
    if m.sensor_ok == 0:
        m.measured = NAN
        flags = INVALID
    elif m.samples % m.sensor_every != 0:
        flags = HELD
    else:
        before = now_of(clock, buffer)
        code = call(m.read, m.read_context, before, value.ctypes.data)
        m.measured = value[0] * m.scale + m.zero
        if code != 0:
            m.measured = NAN
            m.sensor_ok, m.sensor_code = 0, code
        io_ns = now_of(clock, buffer) - before
    m.held = 1 if flags == HELD else 0
    return flags, io_ns


@njit(cache=True, nogil=True)
def run_samples(axes: NDArray[np.int64], samples: int) -> None:
    """Run until all axes have stopped, or for `samples` samples (-1: no limit). axes: (n,)
    addresses of their tables; the first one's clock serves all."""
    n = axes.size
    clock = axis_at(axes[0])
    m = meter_of(clock)
    buffer, value, volts = np.zeros(32, np.int64), np.zeros(1), np.zeros(n)
    flags, wrote = np.zeros(n, np.int64), np.zeros(n, np.int64)
    written, took, ended = np.zeros(n, np.int64), np.zeros(n, np.int64), np.zeros(n, np.int64)
    while samples < 0 or m.samples < samples:
        woke = sleep_of(clock, buffer, m.scheduled_ns, m.spin_ns)
        if woke < m.scheduled_ns:
            continue
        io_ns = np.int64(0)  # not a plain 0: `finish` would be compiled for that type, too
        for i in range(n):
            flags[i], spent_ns = read_gauge(axis_at(axes[i]), clock, buffer)
            io_ns += spent_ns
        begin_axes(axes, now_of(clock, buffer), volts)
        finished = woke
        for i in range(n):
            a = meter_of(axis_at(axes[i]))
            wrote[i] = NOT_WRITTEN
            if volts[i] == volts[i]:
                before = now_of(clock, buffer)
                value[0] = volts[i]
                code = call(a.write, a.write_context, before, value.ctypes.data)
                wrote[i] = WRITTEN
                if code != 0:
                    a.actuator_ok, a.actuator_code = 0, code
                    wrote[i] = NOT_TAKEN
                finished = now_of(clock, buffer)
                took[i] = finished - before
                io_ns += took[i]
            else:
                finished = now_of(clock, buffer)
            written[i] = finished
        for i in range(n):
            table = axis_at(axes[i])
            finish(table, wrote[i], flags[i], woke, finished, io_ns, written[i], took[i])
            if ended[i] == 0 and stopped(table, finished):
                ended[i] = 1
        if ended.all():
            break


def warm_up(monitors: Sequence[LoopMonitor], compiled: bool) -> None:
    """Run every kernel that this engine calls in a sample, on separate monitors without devices.
    The other engine's kernels are left out, because they are large.

    After this nothing is compiled, and the code is in memory.
    """
    for monitor in monitors:
        monitor.numbers[PLACE["actuator_ok"]] = monitor.numbers[PLACE["sensor_ok"]] = 0
    axes, volts = addresses_of(monitors), np.zeros(len(monitors))
    if compiled:
        monitors[0].stepper.table.put(CLOCK, np.array([0, 100, 0, 0]))
    for sample, commands in enumerate(_warming_commands()):
        for monitor in monitors:
            monitor.command(commands)
        if compiled:
            run_samples(axes, sample + 1)
            continue
        systemcalls.sleeper()(0)
        begin_axes(axes, 0, volts)
        for monitor in monitors:
            table = monitor.stepper.table.words
            finish(table, NOT_WRITTEN, INVALID, 0, 1, 0, 1, 1)
            stopped(table, 0)
    for monitor in monitors:
        monitor.attend(clock.monotonic_ns())


def _warming_commands() -> Sequence[NDArray[Any]]:
    """Return the commands before each sample: a trajectory, nothing, and a set-point twice."""
    points, single = np.zeros(2, COMMAND), np.zeros(1, COMMAND)
    points["kind"], points["trajectory"] = LoopCommand.POINT, 1
    points["offset_ns"], points["last"] = (0, 1_000_000), (0, 1)
    single["kind"] = LoopCommand.SETPOINT
    return points, points[:0], single, single, points[:0]


def direct_of(device: Any) -> Direct | None:
    """Return how compiled code calls this device; None where only Python can."""
    return device.direct() if isinstance(device, Reachable) else None


def spin_ns(asked_us: float | None, rate_hz: float) -> int:
    """Return how long the loop waits busy before a deadline [ns]. None: chosen by the rate."""
    if asked_us is None:
        asked_us = SPIN_US if rate_hz > SPIN_ABOVE_HZ else 0.0
    return round(1000 * min(asked_us, 0.5e6 / rate_hz))


class _Axis:
    """The devices of an axis for compiled code. Raises BadInput where one needs Python."""

    def __init__(self, monitor: LoopMonitor) -> None:
        self.monitor = monitor
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

    def attend(self) -> None:
        """Handle devices that failed or came back, and publish status and events."""
        monitor, numbers = self.monitor, self.monitor.numbers
        if numbers[PLACE["actuator_ok"]] == 0:
            if numbers[PLACE["actuator_code"]]:
                self._down("actuator", monitor.actuator, self._write)
            elif monitor.actuator.came_back():
                monitor.floats[PLACE["back_v"]] = monitor.actuator.device.output()
                numbers[PLACE["actuator_back"]] = 1
        if numbers[PLACE["sensor_ok"]] == 0:
            if numbers[PLACE["sensor_code"]]:
                self._down("sensor", monitor.sensor, self._read)
            elif monitor.sensor.came_back():
                numbers[PLACE["sensor_ok"]] = 1
        monitor.attend(clock.monotonic_ns())

    def _down(self, which: str, link: DeviceLink, direct: Direct) -> None:
        """Take over a device whose call has failed with a code."""
        place = PLACE[f"{which}_code"]
        link.down(direct.explain(int(self.monitor.numbers[place])))
        self.monitor.numbers[place] = 0


class CompiledLoop:
    """Run the controllers of all axes in compiled code.

    monitor: of the first axis; beside: of the others. enter: called in the loop's thread before
    the first sample, to set its priority. Raises BadInput where a device needs Python.
    """

    def __init__(
        self,
        monitor: LoopMonitor,
        enter: Callable[[], realtime.Obtained] | None = None,
        beside: Sequence[LoopMonitor] = (),
    ) -> None:
        self._monitors, self._enter = (monitor, *beside), enter
        self._axes = [_Axis(one) for one in self._monitors]

    def run(self, samples: int | None = None) -> None:
        """Run until stopped, or for a number of samples; the calling thread serves the loop."""
        thread = threading.Thread(target=self._run, args=(samples,), name="loop", daemon=True)
        thread.start()
        while True:
            thread.join(ATTEND_S)
            for axis in self._axes:
                axis.attend()
            if not thread.is_alive():
                break
        for monitor in self._monitors:
            monitor.attend(clock.monotonic_ns())
            monitor.publish_status(clock.monotonic_ns())

    def _run(self, samples: int | None) -> None:
        first = self._monitors[0]
        if self._enter is not None:
            obtained = self._enter()
            first.stepper.events.extend(obtained.advice)
            for monitor in self._monitors:
                monitor.obtained = obtained
        table = first.stepper.table.words
        buffer = np.zeros(32, np.int64)
        with systemcalls.schedstat_for([monitor.meter for monitor in self._monitors]):
            if first.samples == 0:
                begin_together(self._monitors, now_of(table, buffer))
            run_samples(addresses_of(self._monitors), -1 if samples is None else samples)
