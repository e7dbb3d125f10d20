"""The Python loop: wait for the deadline, read, step, write, record; all axes in each step.

It serves devices that only Python can reach, mainly serial ones. Its compiled counterpart is
dehyst.daemon.loop.compiled_loop. Nothing here can block for long: no bus, no disk, no log, no
garbage collection, and device calls have their own time-outs.
"""

from collections.abc import Callable, Mapping, Sequence
from typing import NamedTuple

import numpy as np

from dehyst.daemon import clock
from dehyst.daemon.loop import systemcalls
from dehyst.daemon.loop.axes.kernels import begin_axes
from dehyst.daemon.loop.readback import ReadbackCheck
from dehyst.daemon.loop.sample import NOT_TAKEN, NOT_WRITTEN, WRITTEN, finish
from dehyst.daemon.loop.status import PLACE, LoopMonitor, addresses_of, begin_together
from dehyst.daemon.loop.step_kernel import stopped
from dehyst.daemon.rings.records import Flag, State
from dehyst.drivers.interface import DriverError, Joint

INVALID, HELD = int(Flag.SENSOR_INVALID), int(Flag.SENSOR_HELD)
SCHEDULED, SAMPLES, MEASURED = PLACE["scheduled_ns"], PLACE["samples"], PLACE["measured"]
ACTUATOR_OK, SENSOR_OK = PLACE["actuator_ok"], PLACE["sensor_ok"]
DOUBTFUL, THE_HELD = PLACE["doubtful"], PLACE["held"]
ASKED = 2  # in DOUBTFUL for one sample: there is no time for a query and a write
MOVING = (State.RUNNING, State.STOPPING)
NAN = float("nan")


class Axis(NamedTuple):
    """One axis of the loop. readback: the slow check of the amplifier's reported output; None: it
    cannot report it."""

    monitor: LoopMonitor
    readback: ReadbackCheck | None = None


class Together(NamedTuple):
    """Axes, by index, whose outputs one amplifier can set in one command."""

    joint: Joint
    places: tuple[int, ...]


class PythonLoop:
    """Run the controllers of all axes against their devices on one grid of deadlines.

    monitor: of the first axis; beside: the other axes. `now` and `sleep_until` are the injected
    clock, in integer nanoseconds. together: amplifiers that set several of these axes in one
    command; crowded: by axis index, the outputs that are not written in a sample in which that
    axis' amplifier is queried for its output.
    """

    def __init__(
        self,
        monitor: LoopMonitor,
        now: Callable[[], int] = clock.monotonic_ns,
        sleep_until: Callable[[int], int] | None = None,
        readback: ReadbackCheck | None = None,
        beside: Sequence[Axis] = (),
        together: Sequence[Together] = (),
        crowded: Mapping[int, tuple[int, ...]] | None = None,
    ) -> None:
        self._now, self._together, self._crowded = now, together, crowded or {}
        self._sleep_until = sleep_until or systemcalls.sleeper()
        monitors = [monitor, *(axis.monitor for axis in beside)]
        self._volts = np.full(len(monitors), NAN)
        self._addresses = addresses_of(monitors)
        checks = [readback, *(axis.readback for axis in beside)]
        self._axes = [_AxisDevices(*pair, now) for pair in zip(monitors, checks, strict=True)]

    def run(self, samples: int | None = None) -> None:
        """Run until all axes have stopped, or for a number of samples."""
        monitors = [axis.monitor for axis in self._axes]
        numbers, going = monitors[0].numbers, list(self._axes)
        with systemcalls.schedstat_for([monitor.meter for monitor in monitors]):
            if numbers[SAMPLES] == 0:
                begin_together(monitors, self._now())
            while samples is None or numbers[SAMPLES] < samples:
                woke_ns = self._sleep_until(numbers[SCHEDULED])
                if woke_ns < numbers[SCHEDULED]:
                    continue  # a signal woke us
                finished_ns = self._sample(woke_ns)
                for monitor in monitors:
                    monitor.attend(finished_ns)
                going = [axis for axis in going if not stopped(axis.words, finished_ns)]
                if not going:
                    break
        for monitor in monitors:
            monitor.attend(clock.monotonic_ns())
            monitor.publish_status(clock.monotonic_ns())

    def _sample(self, woke_ns: int) -> int:
        axes, io_ns, kept = self._axes, 0, None
        for place, axis in enumerate(axes):
            spent_ns, asked = axis.read_sensor(kept is not None)
            io_ns += spent_ns
            if asked:
                kept = self._crowded.get(place, ())
        for axis in axes:
            axis.take_back()
        for place in kept or ():
            axes[place].monitor.numbers[DOUBTFUL] |= ASKED
        begin_axes(self._addresses, self._now(), self._volts)
        for place in kept or ():
            axes[place].monitor.numbers[DOUBTFUL] &= ~ASKED
        volts = self._volts.tolist()
        for joint, places in self._together:
            io_ns += self._write_together(joint, places, volts)
        finished_ns = woke_ns
        for axis, wanted in zip(axes, volts, strict=True):
            spent_ns, finished_ns = axis.write(wanted)
            io_ns += spent_ns
        for axis in axes:
            axis.finish(woke_ns, finished_ns, io_ns)
        return finished_ns

    def _write_together(self, joint: Joint, places: tuple[int, ...], volts: list[float]) -> int:
        """Set all these outputs in one command if all must be written; return the time [ns]."""
        wanted = [volts[place] for place in places]
        if not joint.together or any(v != v for v in wanted):
            return 0
        before_ns, error = self._now(), None
        try:
            joint.write_all(wanted)
        except DriverError as found:
            error = found
        after_ns = self._now()
        for place in places:
            volts[place] = NAN
            self._axes[place].was_written(before_ns, after_ns, error)
        return after_ns - before_ns


class _AxisDevices:
    """The devices of one axis in a sample, and the result of its write."""

    def __init__(
        self, monitor: LoopMonitor, readback: ReadbackCheck | None, now: Callable[[], int]
    ) -> None:
        self.monitor, self.readback, self._now = monitor, readback, now
        self.words = monitor.stepper.table.words
        self._scale = float(monitor.meter["scale"][0])
        self._zero = float(monitor.meter["zero"][0])
        self._every = int(monitor.meter["sensor_every"][0])
        self._flags, self._wrote, self._written_ns, self._call_ns = 0, NOT_WRITTEN, 0, 0

    def take_back(self) -> None:
        """Resume an amplifier that was down and responds again."""
        monitor, actuator = self.monitor, self.monitor.actuator
        self._wrote = NOT_WRITTEN
        if not actuator.ok and actuator.came_back():
            monitor.meter["back_v"], monitor.meter["actuator_back"] = actuator.device.output(), 1
            monitor.numbers[DOUBTFUL] = 0
            if self.readback is not None:
                self.readback.begin(actuator.device.output())

    def write(self, volts: float) -> tuple[int, int]:
        """Set the output (NaN: leave it); return (time spent [ns], present time [ns])."""
        if volts != volts:
            return 0, self._now()
        actuator, before_ns = self.monitor.actuator, self._now()
        try:
            actuator.device.write(volts)
            error = None
        except DriverError as found:
            error = found
        after_ns = self._now()
        self._settle(after_ns, after_ns - before_ns, error)
        return after_ns - before_ns, after_ns

    def was_written(self, before_ns: int, after_ns: int, error: DriverError | None) -> None:
        """Record that the output was set with others in one command. A command for it alone would
        take at least half as long."""
        self._settle(after_ns, (after_ns - before_ns) // 2, error)

    def _settle(self, written_ns: int, call_ns: int, error: DriverError | None) -> None:
        self._written_ns, self._call_ns, self._wrote = written_ns, call_ns, WRITTEN
        if error is not None:
            monitor = self.monitor
            monitor.actuator.down(error)
            monitor.numbers[ACTUATOR_OK] = 0
            monitor.stepper.events.append(f"the amplifier does not accept voltages: {error}")
            self._wrote = NOT_TAKEN

    def finish(self, woke_ns: int, finished_ns: int, io_ns: int) -> None:
        """Close the sample."""
        finish(
            self.words,
            self._wrote,
            self._flags,
            woke_ns,
            finished_ns,
            io_ns,
            self._written_ns,
            self._call_ns,
        )

    def read_sensor(self, others_asked: bool) -> tuple[int, bool]:
        """Read the sensor into the meter. Return the time in the driver [ns], and whether the
        amplifier was queried for its output; others_asked: another one was, so this one is not."""
        begun_ns = self._now()
        asked = not others_asked and self.readback is not None and self._read_back(self.readback)
        self._flags = self._read(asked)
        self.monitor.numbers[THE_HELD] = 1 if self._flags & HELD else 0
        return self._now() - begun_ns, asked

    def _read(self, asked: bool) -> int:
        """Take the reading; return its flags. asked: there is no time for a reading."""
        monitor, sensor = self.monitor, self.monitor.sensor
        if not sensor.ok:
            monitor.floats[MEASURED] = NAN
            monitor.numbers[SENSOR_OK] = sensor.came_back()
        if not sensor.ok or not monitor.numbers[SENSOR_OK]:
            return INVALID
        if asked or monitor.numbers[SAMPLES] % self._every:
            return HELD
        try:
            reading = sensor.call(sensor.device.read)
            monitor.floats[MEASURED] = reading * self._scale + self._zero
        except DriverError:
            monitor.floats[MEASURED] = NAN
            monitor.numbers[SENSOR_OK] = 0
        return 0

    def _read_back(self, check: ReadbackCheck) -> bool:
        """Check occasionally, instead of a sensor reading, that the amplifier reports what was set.
        Return True when it was queried."""
        monitor, stepper, actuator = self.monitor, self.monitor.stepper, self.monitor.actuator
        now_ns, volts = monitor.numbers[SCHEDULED], stepper.volts
        if not actuator.ok:
            return False
        check.wrote(now_ns, volts)
        if not check.due(now_ns, stepper.state in MOVING):
            return False
        try:
            verdict = check.judge(actuator.call(actuator.device.readback))
        except DriverError as error:
            monitor.numbers[ACTUATOR_OK] = 0
            stepper.fault(now_ns, f"the amplifier does not report its output: {error}")
            return True
        if verdict == "disagrees":
            monitor.numbers[DOUBTFUL] = 1
            stepper.fault(
                now_ns,
                f"the amplifier reports {check.reported_v:.2f} V, but {volts:.2f} V was set "
                "(check its knob and its external input); nothing is written until they agree. A "
                "restart of the daemon accepts the reported voltage",
            )
        elif verdict == "agrees":
            monitor.numbers[DOUBTFUL] = 0
            stepper.events.append("the amplifier's report agrees with the set-point again")
            monitor.meter["back_v"], monitor.meter["actuator_back"] = actuator.device.output(), 1
        return True
