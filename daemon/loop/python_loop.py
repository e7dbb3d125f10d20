"""The Python loop: wait for the deadline, read, step, write, record.

For devices that only Python reaches, serial ones above all; dehyst.daemon.loop.compiled_loop is its
compiled sister. Nothing here can block for long: no bus, no disk, no log, no garbage collection,
and device calls have their own time-outs.
"""

from collections.abc import Callable

from dehyst.daemon import clock
from dehyst.daemon.loop import systemcalls
from dehyst.daemon.loop.readback import ReadbackCheck
from dehyst.daemon.loop.sample import NOT_WRITTEN, REFUSED, WRITTEN, begin, finish
from dehyst.daemon.loop.status import PLACE, LoopMonitor
from dehyst.daemon.loop.step_kernel import stopped
from dehyst.daemon.rings.records import Flag, State
from dehyst.drivers.interface import DriverError

INVALID, HELD = int(Flag.SENSOR_INVALID), int(Flag.SENSOR_HELD)
SCHEDULED, SAMPLES, MEASURED = PLACE["scheduled_ns"], PLACE["samples"], PLACE["measured"]
ACTUATOR_OK, SENSOR_OK = PLACE["actuator_ok"], PLACE["sensor_ok"]
DOUBTFUL, THE_HELD = PLACE["doubtful"], PLACE["held"]
MOVING = (State.RUNNING, State.STOPPING)
NAN = float("nan")


class PythonLoop:
    """Runs a monitor's controller against its devices on a grid of deadlines.

    `now` and `sleep_until` are the clock, injected: integer nanoseconds. readback: where the
    amplifier can report its output, the slow check of that report.
    """

    def __init__(
        self,
        monitor: LoopMonitor,
        now: Callable[[], int] = clock.monotonic_ns,
        sleep_until: Callable[[int], int] | None = None,
        readback: ReadbackCheck | None = None,
    ) -> None:
        self.monitor, self._now, self.readback = monitor, now, readback
        self._sleep_until = sleep_until or systemcalls.sleeper()
        self._words = monitor.stepper.table.words
        self._scale = float(monitor.meter["scale"][0])
        self._zero = float(monitor.meter["zero"][0])
        self._every = int(monitor.meter["sensor_every"][0])

    def run(self, samples: int | None = None) -> None:
        """Loop until stopped (or for a number of samples)."""
        monitor, numbers = self.monitor, self.monitor.numbers
        monitor.meter["schedstat"] = systemcalls.open_schedstat()
        if numbers[SAMPLES] == 0:
            monitor.begin(self._now())
        while samples is None or numbers[SAMPLES] < samples:
            woke_ns = self._sleep_until(numbers[SCHEDULED])
            if woke_ns < numbers[SCHEDULED]:
                continue  # a signal woke us
            finished_ns = self._sample(woke_ns)
            monitor.attend(finished_ns)
            if stopped(self._words, finished_ns):
                break
        monitor.attend(clock.monotonic_ns())
        monitor.publish_status(clock.monotonic_ns())

    def _sample(self, woke_ns: int) -> int:
        monitor = self.monitor
        flags, io_ns = self._read_sensor()
        monitor.numbers[THE_HELD] = 1 if flags & HELD else 0
        actuator = monitor.actuator
        if not actuator.ok and actuator.came_back():
            monitor.meter["back_v"], monitor.meter["actuator_back"] = actuator.device.output(), 1
            monitor.numbers[DOUBTFUL] = 0
            if self.readback is not None:
                self.readback.begin(actuator.device.output())
        volts = begin(self._words, self._now())
        wrote = NOT_WRITTEN
        if volts == volts:
            before_ns = self._now()
            try:
                actuator.call(actuator.device.write, volts)
                wrote = WRITTEN
            except DriverError as error:
                monitor.numbers[ACTUATOR_OK] = 0
                monitor.stepper.events.append(f"the amplifier does not take voltages: {error}")
                wrote = REFUSED
            finished_ns = self._now()
            io_ns += finished_ns - before_ns
        else:
            finished_ns = self._now()
        finish(self._words, wrote, flags, woke_ns, finished_ns, io_ns)
        return finished_ns

    def _read_sensor(self) -> tuple[int, int]:
        """(flags, nanoseconds in the driver); the reading goes into the meter."""
        monitor, sensor = self.monitor, self.monitor.sensor
        if not sensor.ok:
            monitor.floats[MEASURED] = NAN
            monitor.numbers[SENSOR_OK] = sensor.came_back()
        before_ns = self._now()
        asked = self.readback is not None and self._read_back(self.readback)
        if not sensor.ok or not monitor.numbers[SENSOR_OK]:
            return INVALID, self._now() - before_ns
        if asked or monitor.numbers[SAMPLES] % self._every:
            return HELD, self._now() - before_ns
        try:
            reading = sensor.call(sensor.device.read)
            monitor.floats[MEASURED] = reading * self._scale + self._zero
        except DriverError:
            monitor.floats[MEASURED] = NAN
            monitor.numbers[SENSOR_OK] = 0
        return 0, self._now() - before_ns

    def _read_back(self, check: ReadbackCheck) -> bool:
        """Now and then, in the place of a sensor reading: does the amplifier report what was
        set? True when it was asked."""
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
                f"the amplifier reports {check.reported_v:.2f} V where {volts:.2f} V was set (its "
                "knob, its external input?): nothing is written until they agree; a restart of "
                "the daemon takes the reported voltage for true",
            )
        elif verdict == "agrees":
            monitor.numbers[DOUBTFUL] = 0
            stepper.events.append("the amplifier reports what was set again")
            monitor.meter["back_v"], monitor.meter["actuator_back"] = actuator.device.output(), 1
        return True
