"""The loop's monitor: its meter and histograms, its status and events, and requests to it.

Both loops share it. The kernels count and make notes; Python turns these into records and messages
once a second, at every change of state, and after every event.
"""

import os
from collections.abc import Callable, Sequence
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from dehyst.daemon import clock
from dehyst.daemon.loop import records_in_memory
from dehyst.daemon.loop.devices import DeviceLink
from dehyst.daemon.loop.records_in_memory import CAUSES, CONTROL_T, METER_T
from dehyst.daemon.loop.step import Stepper
from dehyst.daemon.loop.timing import realtime
from dehyst.daemon.loop.timing.deadlines import next_ns
from dehyst.daemon.loop.timing.histogram import Histogram
from dehyst.daemon.loop.timing.witness import Witness
from dehyst.daemon.rings.records import EVENT, State
from dehyst.daemon.rings.ring import Ring
from dehyst.daemon.rings.status import STATUS, USUAL_SHIFT
from dehyst.models.inverse.compensator import Compensator, CompensatorState

PLACE = {name: i for i, name in enumerate(METER_T.names or ())}
_STATE = (CONTROL_T.names or ()).index("state")
_NOTES = (CONTROL_T.names or ()).index("notes")


class SensorConversion(NamedTuple):
    """How the sensor is read: scale and zero convert its unit to the model's; every n-th sample."""

    scale: float = 1.0
    zero: float = 0.0
    every: int = 1


AS_IT_COMES = SensorConversion()
SEEN_NS = 1_000_000_000  # duration of readings before gauge and model are compared
FAR = 0.02
"""Part of the reach: at a start, a larger difference between gauge and model means an unknown
position, not noise or the gauge's zero."""
NO_ROWS = np.zeros(0, records_in_memory.FOLLOW_T)


def begin_together(monitors: Sequence["LoopMonitor"], now_ns: int) -> None:
    """Set the first deadline of all axes to the same grid point after now_ns, unless the loop has
    already run."""
    first, *others = monitors
    first.begin(now_ns)
    for monitor in others:
        monitor.numbers[PLACE["scheduled_ns"]] = first.numbers[PLACE["scheduled_ns"]]


def addresses_of(monitors: Sequence["LoopMonitor"]) -> NDArray[np.int64]:
    """Return (n,) addresses of the axes' tables, for the kernels."""
    return np.array([monitor.stepper.table.address for monitor in monitors], np.int64)


class LoopMonitor:
    """One controller's meter, by names of METER_T: `monitor.numbers[PLACE["missed"]]`.

    `numbers`, `floats`: the meter's fields as Python integers or floats, in the same memory.
    fill_status: adds to a STATUS record what only the core knows.
    """

    def __init__(
        self,
        stepper: Stepper,
        actuator: DeviceLink,
        sensor: DeviceLink,
        rings: dict[str, Ring],
        reading: SensorConversion = AS_IT_COMES,
        spin_ns: int = 0,
        fill_status: Callable[[NDArray[Any]], None] = lambda _: None,
    ) -> None:
        self.stepper, self.actuator, self.sensor = stepper, actuator, sensor
        self.obtained = realtime.Obtained(False, 0, False, ())
        self.wake, self.exec, self.io = Histogram(), Histogram(), Histogram()
        self.missed_by = np.zeros(CAUSES, np.int64)
        self.meter = np.zeros(1, METER_T)
        self.numbers: Any = memoryview(self.meter.view(np.int64))  # type: ignore[arg-type]
        self.floats: Any = memoryview(self.meter.view(np.float64))  # type: ignore[arg-type]
        self._control: Any = memoryview(stepper.control.view(np.int64))  # type: ignore[arg-type]
        self._rings, self._fill_status = rings, fill_status
        self._status, self._event = np.zeros(1, STATUS), np.zeros(1, EVENT)
        self._placed = False
        self._status_ns, self._last_state, self._notes = 0, int(State.START), 0
        self._next: tuple[Any, ...] | None = None
        self._next_rows = NO_ROWS
        m = self.meter
        m["measured"], m["schedstat"] = np.nan, -1
        m["scale"], m["zero"] = reading.scale, reading.zero
        m["sensor_every"], m["spin_ns"] = reading.every, spin_ns
        m["actuator_ok"] = m["sensor_ok"] = 1
        m["tail"] = rings["command"].head
        places = {
            records_in_memory.METER: self.meter,
            records_in_memory.MISSED_BY: self.missed_by,
            records_in_memory.WAKE: self.wake.bins,
            records_in_memory.WAKE_MOST: self.wake.extreme,
            records_in_memory.EXEC: self.exec.bins,
            records_in_memory.EXEC_MOST: self.exec.extreme,
            records_in_memory.IO: self.io.bins,
            records_in_memory.IO_MOST: self.io.extreme,
            records_in_memory.COMMAND_WORDS: rings["command"].words,
            records_in_memory.COMMAND_RING: rings["command"].records,
            records_in_memory.COMMAND_DATA: rings["command"].data,
            records_in_memory.COMMAND_CHECKS: rings["command"].checks,
            records_in_memory.TELEMETRY_WORDS: rings["telemetry"].words,
            records_in_memory.TELEMETRY_RING: rings["telemetry"].records,
            records_in_memory.TELEMETRY_DATA: rings["telemetry"].data,
            records_in_memory.TELEMETRY_CHECKS: rings["telemetry"].checks,
            records_in_memory.BUFFER: np.zeros(32, np.int64),
        }
        for place, array in places.items():
            stepper.table.put(place, array)

    @property
    def samples(self) -> int:
        """Return the number of samples so far."""
        return int(self.numbers[PLACE["samples"]])

    @property
    def missed(self) -> int:
        """Return the number of deadlines missed so far."""
        return int(self.numbers[PLACE["missed"]])

    # -- requests ---------------------------------------------------------------------------------

    def command(self, commands: NDArray[Any]) -> None:
        """Send these COMMAND records to the loop, as the gateway does."""
        self._rings["command"].push_many(commands)

    def use_witness(self, witness: Witness) -> None:
        """Let this witness explain late samples; the loop takes its grid of deadlines from it."""
        self.numbers[PLACE["scheduled_ns"]] = witness.grid_ns
        self.stepper.table.put(records_in_memory.WITNESS, witness.logs)

    def begin(self, now_ns: int) -> None:
        """Set the first deadline after now_ns, unless the loop has already run."""
        period_ns = self.stepper.settings.period_ns
        if self.samples == 0:
            grid_ns = self.numbers[PLACE["scheduled_ns"]] or now_ns
            self.numbers[PLACE["scheduled_ns"]] = next_ns(grid_ns, now_ns, period_ns)

    def stop(self) -> None:
        """Request the stop: the output first goes to its configured state. May be called from any
        thread or signal handler."""
        self.numbers[PLACE["stop"]] = 1

    def reload(
        self,
        compensator: Compensator,
        inverse: CompensatorState,
        origin: float,
        rows: NDArray[Any] = NO_ROWS,
    ) -> None:
        """Let the loop use another model from its next sample on. May be called from any thread.
        rows: (n,) FOLLOW_T, the channels that follow other axes."""
        for _ in range(1000):  # wait for a previous request, about 1 s at most
            if self.numbers[PLACE["swap"]] == 0:
                break
            clock.sleep_s(0.001)
        self._settle_reload()
        self.stepper.fill_channels(compensator, inverse)
        self._next, self._next_rows = (compensator, inverse), rows
        self.numbers[PLACE["swap_rows"]] = rows.ctypes.data
        self.numbers[PLACE["swap_n_rows"]] = rows.size
        self.floats[PLACE["swap_origin"]] = origin
        self.numbers[PLACE["swap"]] = inverse.address

    def _settle_reload(self) -> None:
        """Free the old model once the loop no longer uses it."""
        if self._next is not None and self.numbers[PLACE["swap"]] == 0:
            self.stepper.taken(*self._next)
            self.stepper.follow(self._next_rows)
            self._next = None

    # -- status and events ------------------------------------------------------------------------

    def attend(self, now_ns: int) -> None:
        """Publish status and events that are due; cheap when nothing is."""
        due = now_ns - self._status_ns >= clock.NS
        if self._control[_NOTES] != self._notes:
            self._notes = self._control[_NOTES]
            # readings after a shift of the zero must not be compared with those before
            due |= self.stepper.trim["zero"][0] != self._status["gauge_zero"][0]
            self.stepper.collect_events()
            self._settle_reload()
        for link in (self.actuator, self.sensor):
            while link.news:  # one by one: the reconnecting thread may add one meanwhile
                self.stepper.events.append(link.news.popleft())
        if due or self._control[_STATE] != self._last_state:
            self.publish_status(now_ns)
        if self.stepper.events:
            self._publish_events(now_ns)

    def publish_status(self, now_ns: int) -> None:
        """Push one STATUS record and restart the histograms."""
        stepper = self.stepper
        self._status_ns, self._last_state = now_ns, self._control[_STATE]
        row = self._status[0]
        row["time_ns"], row["wall_ns"] = now_ns, clock.wall_ns()
        row["state"], row["mode"] = self._last_state, stepper.record[0]["mode"]
        row["policy"], row["priority"] = self.obtained.fifo, self.obtained.priority
        row["samples"] = self.samples
        row["missed_by"][: self.missed_by.size] = self.missed_by
        row["missed"] = row["missed_by"].sum()  # not the meter's: the loop may count on meanwhile
        for name, histogram in (("wake_us", self.wake), ("exec_us", self.exec), ("io_us", self.io)):
            row[name] = histogram.summary()
            histogram.clear()
        row["actuator_ok"] = self.actuator.ok and not self.numbers[PLACE["doubtful"]]
        row["sensor_ok"] = self.sensor.ok
        row["actuator_errors"], row["sensor_errors"] = self.actuator.errors, self.sensor.errors
        row["volts"] = stepper.volts
        trim, control = stepper.trim[0], stepper.control[0]
        row["trimmed"], row["trim"] = stepper.trim_setting["on"][0], trim["trim"]
        row["trim_frozen"], row["differs"] = trim["lasting"], trim["seen"]
        played = stepper.queue.numbers["count"][0] or control["learned"]
        row["stays"] = control["stays"]
        row["learned"] = control["corrected"] and played and self._last_state == State.RUNNING
        row["gauge_zero"] = trim["zero"]
        row["trajectory_start_ns"] = stepper.queue.begun_ns
        row["queue_s"] = stepper.queue.ahead_s(now_ns)
        row["trajectory"], row["trajectory_done"] = stepper.trajectory, stepper.trajectory_done
        row["origin"], row["period_ns"] = stepper.origin, stepper.settings.period_ns
        row["pid"] = os.getpid()
        self._fill_status(self._status)
        self._offer_zero(row)
        self._mend()
        self._rings["status"].push(row)

    def _offer_zero(self, row: Any) -> None:
        """Report once that the stage is not where the model predicts: its past is unknown."""
        if self._placed or row["state"] != State.READY or self.samples * row["period_ns"] < SEEN_NS:
            return
        self._placed = True
        reach, differs = float(row["reach_max"] - row["reach_min"]), float(row["differs"])
        if abs(differs) > FAR * reach:  # False where there is no reading
            unit = bytes(row["unit"]).decode("utf-8", "replace")
            text = (
                f"the gauge is {differs:+.3g} {unit} from the model: after a start the history of "
                "the stage is unknown; `dehyst zero --exercise` erases it and finds the position"
            )
            if abs(differs) > USUAL_SHIFT * reach:
                text += (
                    f"; if more than {100 * USUAL_SHIFT:g} % of the reach remains, the model may "
                    "be another stage's"
                )
            self.stepper.events.append(text)

    def _mend(self) -> None:
        """Repair damaged rings, because a reader that attaches later relies on them."""
        for name, ring in self._rings.items():
            try:
                if not ring.mend():
                    self.stepper.events.append(f"{name}.ring was damaged; it is whole again")
            except OSError as error:
                self.stepper.events.append(f"{name}.ring cannot be repaired: {error.strerror}")
        self._rings["command"].taken(self.numbers[PLACE["tail"]])

    def _publish_events(self, now_ns: int) -> None:
        wall_ns, state = clock.wall_ns(), State(self._control[_STATE])
        event = self._event
        while self.stepper.events:  # one by one: other threads may add one meanwhile
            text = self.stepper.events.pop(0)
            event["time_ns"], event["wall_ns"] = now_ns, wall_ns
            event["level"] = 2 if state is State.FAULT else 1
            event["code"], event["text"] = state.name.lower(), text.encode()[:400]
            self._rings["event"].push(event[0])
