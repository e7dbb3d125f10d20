"""The Python loop: wait for the deadline, read, step, write, record.

For devices that only Python reaches, serial ones above all; dehyst.daemon.engine is its compiled
sister. Nothing here can block for long: no bus, no disk, no log, no garbage collection, and device
calls have their own time-outs.
"""

from collections.abc import Callable

import numpy as np

from dehyst.daemon import clock, systemcalls
from dehyst.daemon.desk import PLACE, Desk
from dehyst.daemon.readback import ReadbackCheck
from dehyst.daemon.records import Flag, State
from dehyst.daemon.sample_kernel import NOT_WRITTEN, REFUSED, WRITTEN, begin, finish
from dehyst.daemon.step_kernel import stopped
from dehyst.drivers.interface import DriverError

INVALID, HELD = int(Flag.SENSOR_INVALID), int(Flag.SENSOR_HELD)
SCHEDULED, SAMPLES, MEASURED = PLACE["scheduled_ns"], PLACE["samples"], PLACE["measured"]
ACTUATOR_OK, SENSOR_OK = PLACE["actuator_ok"], PLACE["sensor_ok"]
DOUBTFUL = PLACE["doubtful"]
MOVING = (State.RUNNING, State.STOPPING)
NAN = float("nan")


def sleeper() -> Callable[[int], int]:
    """A function that sleeps until CLOCK_MONOTONIC reaches its argument and returns the time."""
    buffer = np.zeros(32, np.int64)

    def sleep_until(deadline_ns: int) -> int:
        systemcalls.sleep_until_ns(buffer, deadline_ns)
        return clock.monotonic_ns()

    return sleep_until


class Loop:
    """Runs a desk's controller against its devices on a grid of deadlines.

    `now` and `sleep_until` are the clock, injected: integer nanoseconds. readback: where the
    amplifier can report its output, the slow check of that report.
    """

    def __init__(
        self,
        desk: Desk,
        now: Callable[[], int] = clock.monotonic_ns,
        sleep_until: Callable[[int], int] | None = None,
        readback: ReadbackCheck | None = None,
    ) -> None:
        self.desk, self._now, self.readback = desk, now, readback
        self._sleep_until = sleep_until or sleeper()
        self._words = desk.stepper.table.words
        self._scale = float(desk.meter["scale"][0])
        self._zero = float(desk.meter["zero"][0])
        self._every = int(desk.meter["sensor_every"][0])

    def run(self, samples: int | None = None) -> None:
        """Loop until stopped (or for a number of samples)."""
        desk, numbers = self.desk, self.desk.numbers
        desk.meter["schedstat"] = systemcalls.open_schedstat()
        if numbers[SAMPLES] == 0:
            desk.begin(self._now())
        while samples is None or numbers[SAMPLES] < samples:
            woke_ns = self._sleep_until(numbers[SCHEDULED])
            if woke_ns < numbers[SCHEDULED]:
                continue  # a signal woke us
            finished_ns = self._sample(woke_ns)
            desk.attend(finished_ns)
            if stopped(self._words, finished_ns):
                break
        desk.attend(clock.monotonic_ns())
        desk.publish_status(clock.monotonic_ns())

    def _sample(self, woke_ns: int) -> int:
        desk = self.desk
        flags, io_ns = self._read_sensor()
        actuator = desk.actuator
        if not actuator.ok and actuator.came_back():
            desk.meter["back_v"], desk.meter["actuator_back"] = actuator.device.output(), 1
            desk.numbers[DOUBTFUL] = 0
            if self.readback is not None:
                self.readback.begin(actuator.device.output())
        volts = begin(self._words)
        wrote = NOT_WRITTEN
        if volts == volts:
            before_ns = self._now()
            try:
                actuator.call(actuator.device.write, volts)
                wrote = WRITTEN
            except DriverError as error:
                desk.numbers[ACTUATOR_OK] = 0
                desk.stepper.events.append(f"the amplifier does not take voltages: {error}")
                wrote = REFUSED
            finished_ns = self._now()
            io_ns += finished_ns - before_ns
        else:
            finished_ns = self._now()
        finish(self._words, wrote, flags, woke_ns, finished_ns, io_ns)
        return finished_ns

    def _read_sensor(self) -> tuple[int, int]:
        """(flags, nanoseconds in the driver); the reading goes into the meter."""
        desk, sensor = self.desk, self.desk.sensor
        if not sensor.ok:
            desk.floats[MEASURED] = NAN
            desk.numbers[SENSOR_OK] = sensor.came_back()
        before_ns = self._now()
        asked = self.readback is not None and self._read_back(self.readback)
        if not sensor.ok or not desk.numbers[SENSOR_OK]:
            return INVALID, self._now() - before_ns
        if asked or desk.numbers[SAMPLES] % self._every:
            return HELD, self._now() - before_ns
        try:
            reading = sensor.call(sensor.device.read)
            desk.floats[MEASURED] = reading * self._scale + self._zero
        except DriverError:
            desk.floats[MEASURED] = NAN
            desk.numbers[SENSOR_OK] = 0
        return 0, self._now() - before_ns

    def _read_back(self, check: ReadbackCheck) -> bool:
        """Now and then, in the place of a sensor reading: does the amplifier report what was
        set? True when it was asked."""
        desk, stepper, actuator = self.desk, self.desk.stepper, self.desk.actuator
        now_ns, volts = desk.numbers[SCHEDULED], stepper.volts
        if not actuator.ok:
            return False
        check.wrote(now_ns, volts)
        if not check.due(now_ns, stepper.state in MOVING):
            return False
        try:
            verdict = check.judge(actuator.call(actuator.device.readback))
        except DriverError as error:
            desk.numbers[ACTUATOR_OK] = 0
            stepper.fault(now_ns, f"the amplifier does not report its output: {error}")
            return True
        if verdict == "disagrees":
            desk.numbers[DOUBTFUL] = 1
            stepper.fault(
                now_ns,
                f"the amplifier reports {check.reported_v:.2f} V where {volts:.2f} V was set (its "
                "knob, its external input?): nothing is written until they agree; a restart of "
                "the daemon takes the reported voltage for true",
            )
        elif verdict == "agrees":
            desk.numbers[DOUBTFUL] = 0
            stepper.events.append("the amplifier reports what was set again")
            desk.meter["back_v"], desk.meter["actuator_back"] = actuator.device.output(), 1
        return True
