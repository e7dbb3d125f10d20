"""The loop: wait for the deadline, read, step, write, record. Nothing here can block for long:
no bus, no disk, no log, no garbage collection, and device calls have their own time-outs.
"""

import os
import resource
import threading
from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import NDArray

from dehyst.daemon import clock, realtime
from dehyst.daemon.devices import Link
from dehyst.daemon.histogram import Histogram
from dehyst.daemon.readback import ReadbackCheck
from dehyst.daemon.records import COMMAND, EVENT, STATUS, Flag, MissCause, State
from dehyst.daemon.ring import Ring
from dehyst.daemon.step import Stepper
from dehyst.daemon.ticks import Ticks
from dehyst.drivers.interface import DriverError

COMMANDS_PER_SAMPLE = 512
NO_COMMANDS: NDArray[Any] = np.zeros(0, COMMAND)
WITNESS_PERIOD_NS = 1_000_000
STRANDED_NS = 10_000_000_000
"""At the end of the daemon an amplifier that does not answer is waited for so long."""


class Witness:
    """Nogil threads at a higher priority, one a CPU, that log when the machine stood still."""

    def __init__(self, threshold_ns: int, cpus: tuple[int, ...], priority: int) -> None:
        self._stop = np.zeros(1, np.int64)
        self._logs = {cpu: np.zeros(2 * 256 + 1, np.int64) for cpu in cpus}
        self._threads = [
            threading.Thread(target=self._run, args=(cpu, log, threshold_ns, priority), daemon=True)
            for cpu, log in self._logs.items()
        ]
        for thread in self._threads:
            thread.start()

    def _run(self, cpu: int, log: NDArray[np.int64], threshold_ns: int, priority: int) -> None:
        os.sched_setaffinity(0, {cpu})
        if priority:
            os.sched_setscheduler(0, os.SCHED_FIFO, os.sched_param(min(priority + 1, 99)))
        realtime.witness(WITNESS_PERIOD_NS, threshold_ns, self._stop, log)

    @property
    def stalls(self) -> int:
        """Stalls seen on all CPUs."""
        return sum(int(log[0]) for log in self._logs.values())

    def saw_stall(self, from_ns: int, to_ns: int) -> bool:
        """True when a CPU stood still at some time between the two."""
        for log in self._logs.values():
            woke = log[1::2]
            if np.any((woke >= from_ns) & (woke - log[2::2] <= to_ns) & (log[2::2] > 0)):
                return True
        return False

    def close(self) -> None:
        """End the threads."""
        self._stop[0] = 1
        for thread in self._threads:
            thread.join(timeout=1.0)


class Loop:
    """Runs a Stepper against real devices on a grid of deadlines.

    sensor_every: the sensor is read at every n-th sample. `now` and `sleep_until` are the clock.
    """

    def __init__(
        self,
        stepper: Stepper,
        actuator: Link,
        sensor: Link,
        rings: dict[str, Ring],
        sensor_scale: float,
        sensor_zero: float,
        sensor_every: int,
        obtained: realtime.Obtained,
        status: Callable[[NDArray[Any]], None],
        now: Callable[[], int] = clock.monotonic_ns,
        sleep_until: Callable[[int], None] = realtime.sleep_until_ns,
    ) -> None:
        self.stepper, self.actuator, self.sensor = stepper, actuator, sensor
        self._rings, self._scale, self._zero, self._every = (
            rings, sensor_scale, sensor_zero, sensor_every,
        )  # fmt: skip
        self._obtained, self._fill_status = obtained, status
        self._now, self._sleep_until = now, sleep_until
        period_ns = stepper.plan.period_ns
        self.ticks = Ticks(0, period_ns)
        self.missed_by = np.zeros(len(MissCause), np.int64)
        self.wake, self.exec, self.io = Histogram(), Histogram(), Histogram()
        self.witness: Witness | None = None
        self.readback: ReadbackCheck | None = None
        self._heard_ns = 0  # when the amplifier was last in order
        self.stop_requested = False
        self.pending_reload: Callable[[], None] | None = None
        self._tail = rings["command"].head
        self._measured = float("nan")
        self._status = np.zeros(1, STATUS)
        self._status_ns = 0
        self._last_state = State.START
        self._usage = resource.getrusage(resource.RUSAGE_THREAD)

    def run(self, samples: int | None = None) -> None:
        """Loop until stopped (or for a number of samples)."""
        self.ticks.scheduled_ns = self._now() + self.ticks.period_ns
        while samples is None or self.ticks.samples < samples:
            self._sleep_until(self.ticks.scheduled_ns)
            woke_ns = self._now()
            if woke_ns < self.ticks.scheduled_ns:
                continue  # a signal woke us
            self._sample(woke_ns)
            if self.stepper.stopped or self._stranded(woke_ns):
                break
        self._publish_status(self._now())

    def _stranded(self, now_ns: int) -> bool:
        """The end was asked for and the output cannot be moved: it stays where it is."""
        doubtful = self.readback is not None and self.readback.doubtful
        if self.actuator.ok and not doubtful:
            self._heard_ns = now_ns
        if self.stepper.state is not State.STOPPING or self.stepper.stopped:
            return False
        if not doubtful and now_ns - self._heard_ns < STRANDED_NS:
            return False
        why = "reports another voltage than was set" if doubtful else "does not answer"
        self.stepper.events.append(f"the amplifier {why}: the output stays where it is")
        self._publish_events(now_ns)
        return True

    def _sample(self, woke_ns: int) -> None:
        stepper, scheduled_ns = self.stepper, self.ticks.scheduled_ns
        if self.stop_requested:
            stepper.stop(scheduled_ns)
        if self.pending_reload is not None:
            self.pending_reload()
            self.pending_reload = None
        flags, io_ns = self._read_sensor()
        if self.actuator.came_back():
            stepper.recovered(scheduled_ns, self.actuator.device.output())
            if self.readback is not None:
                self.readback.begin(stepper.volts)
        commands = NO_COMMANDS
        ring = self._rings["command"]
        if ring.head != self._tail:
            commands, self._tail, lost = ring.read(self._tail, COMMANDS_PER_SAMPLE)
            ring.taken(self._tail)
            if lost:
                stepper.events.append(f"{lost} commands overwritten before the loop took them")
        record = stepper.step(scheduled_ns, self._measured, commands)
        before_ns = self._now()
        flags |= self._write(scheduled_ns, float(record["volts"][0]))
        finished_ns = self._now()
        io_ns += finished_ns - before_ns
        row = record[0]
        row["seq"], row["scheduled_ns"], row["actual_ns"] = (
            self.ticks.samples, scheduled_ns, woke_ns,
        )  # fmt: skip
        row["io_us"], row["exec_us"] = io_ns * 1e-3, (finished_ns - woke_ns) * 1e-3
        self.wake.add(self.ticks.lateness_ns(woke_ns) * 1e-3)
        self.exec.add((finished_ns - woke_ns) * 1e-3)
        self.io.add(io_ns * 1e-3)
        missed = self.ticks.finish(finished_ns)
        cause = MissCause.NONE
        usage = resource.getrusage(resource.RUSAGE_THREAD)
        if missed:
            cause = self._cause(usage, scheduled_ns, woke_ns, finished_ns, io_ns)
            self.missed_by[cause] += missed
            flags |= Flag.MISSED
        self._usage = usage
        row["cause"] = cause
        row["flags"] |= flags
        self._rings["telemetry"].push(record[0])
        if stepper.state is not self._last_state or finished_ns - self._status_ns >= clock.NS:
            self._publish_status(finished_ns)
        for link in (self.actuator, self.sensor):
            if link.news:
                stepper.events.extend(link.news)
                link.news.clear()
        if stepper.events:
            self._publish_events(finished_ns)

    def _read_sensor(self) -> tuple[Flag, int]:
        if not self.sensor.ok:
            self._measured = float("nan")
            self.sensor.came_back()
        before_ns = self._now()
        asked = self._read_back()
        if not self.sensor.ok:
            return Flag.SENSOR_INVALID, self._now() - before_ns
        if asked or self.ticks.samples % self._every:
            return Flag.SENSOR_HELD, self._now() - before_ns
        try:
            reading = self.sensor.call(self.sensor.device.read)
            self._measured = reading * self._scale + self._zero
        except DriverError:
            self._measured = float("nan")
        return Flag(0), self._now() - before_ns

    def _read_back(self) -> bool:
        """Now and then, in the place of a sensor reading: does the amplifier report what was
        set? True when it was asked."""
        check, stepper, now_ns = self.readback, self.stepper, self.ticks.scheduled_ns
        if check is None or not self.actuator.ok:
            return False
        check.wrote(now_ns, stepper.volts)
        if not check.due(now_ns, stepper.state in (State.RUNNING, State.STOPPING)):
            return False
        try:
            verdict = check.judge(self.actuator.call(self.actuator.device.readback))
        except DriverError as error:
            stepper.fault(now_ns, f"the amplifier does not report its output: {error}")
            return True
        if verdict == "disagrees":
            stepper.fault(
                now_ns,
                f"the amplifier reports {check.reported_v:.2f} V where {stepper.volts:.2f} V was "
                "set (its knob, its external input?): nothing is written until they agree; a "
                "restart of the daemon takes the reported voltage for true",
            )
        elif verdict == "agrees" and stepper.state is State.FAULT:
            stepper.events.append("the amplifier reports what was set again")
            stepper.recovered(now_ns, self.actuator.device.output())
        return True

    def _write(self, scheduled_ns: int, volts: float) -> Flag:
        stepper = self.stepper
        doubtful = self.readback is not None and self.readback.doubtful
        if stepper.state is State.FAULT or doubtful or not self.actuator.ok:
            stepper.record[0]["volts"] = stepper.volts
            stepper.written(stepper.volts)
            return Flag(0)
        if stepper.state is State.READY and volts == stepper.volts:
            stepper.written(volts)  # nobody commands: the bus to the amplifier stays quiet
            return Flag(0)
        try:
            self.actuator.call(self.actuator.device.write, volts)
        except DriverError as error:
            stepper.fault(scheduled_ns, f"the amplifier does not take voltages: {error}")
            stepper.record[0]["volts"] = stepper.volts
            stepper.written(stepper.volts)
            return Flag.WRITE_FAILED
        stepper.written(volts)
        return Flag(0)

    def _cause(
        self, usage: Any, scheduled_ns: int, woke_ns: int, finished_ns: int, io_ns: int
    ) -> MissCause:
        """Why a deadline was missed, strongest evidence first."""
        if self.witness is not None and self.witness.saw_stall(scheduled_ns, finished_ns):
            return MissCause.STALL
        if io_ns > self.ticks.period_ns // 2:
            return MissCause.DRIVER_IO
        if usage.ru_majflt != self._usage.ru_majflt:
            return MissCause.PAGE_FAULT
        if usage.ru_nivcsw != self._usage.ru_nivcsw:
            return MissCause.PREEMPTED
        if woke_ns - scheduled_ns > self.ticks.period_ns // 2:
            return MissCause.LATE_WAKE
        return MissCause.COMPUTE

    def _publish_status(self, now_ns: int) -> None:
        self._status_ns, self._last_state = now_ns, self.stepper.state
        row, stepper = self._status[0], self.stepper
        row["time_ns"], row["wall_ns"] = now_ns, clock.wall_ns()
        row["state"], row["mode"] = stepper.state, stepper.record[0]["mode"]
        row["policy"], row["priority"] = self._obtained.fifo, self._obtained.priority
        row["samples"], row["missed"] = self.ticks.samples, self.ticks.missed
        row["missed_by"][: self.missed_by.size] = self.missed_by
        for name, histogram in (("wake_us", self.wake), ("exec_us", self.exec), ("io_us", self.io)):
            row[name] = histogram.summary()
            histogram.clear()
        row["actuator_ok"], row["sensor_ok"] = self.actuator.ok, self.sensor.ok
        row["actuator_errors"], row["sensor_errors"] = self.actuator.errors, self.sensor.errors
        row["volts"] = stepper.volts
        row["queue_s"] = stepper.queue.ahead_s(now_ns)
        row["trajectory"], row["trajectory_done"] = stepper.trajectory, stepper.trajectory_done
        row["origin"], row["period_ns"] = stepper.plan.origin, self.ticks.period_ns
        row["pid"] = os.getpid()
        self._fill_status(self._status)
        self._rings["status"].push(row)

    def _publish_events(self, now_ns: int) -> None:
        wall_ns = clock.wall_ns()
        for text in self.stepper.events:
            event = np.zeros(1, EVENT)
            event["time_ns"], event["wall_ns"] = now_ns, wall_ns
            event["level"] = 2 if self.stepper.state is State.FAULT else 1
            event["code"], event["text"] = self.stepper.state.name.lower(), text.encode()[:400]
            self._rings["event"].push(event[0])
        self.stepper.events.clear()
