"""One sample of the controller, without clock, bus or device: the kernels' Python interface.

dehyst.daemon.rings.records.State describes what each state does to the voltage;
dehyst.daemon.loop.step_kernel has the rules. The sensor is read before the voltage is written: a
voltage is computed for the target one period ahead, and `predicted` is the model's prediction of
the reading in the same record. Everything here is deterministic: the same inputs give the same
records, so the tests can replay recorded runs. Targets and displacements count from the set-point
origin, voltages are the actuator's.
"""

from typing import Any

import numpy as np
from numpy.typing import NDArray

from dehyst.daemon.loop import records_in_memory, step_kernel
from dehyst.daemon.loop.records_in_memory import (
    COMMANDS_PER_SAMPLE,
    CONTROL_T,
    NOTE_T,
    NOTES,
    describe_note,
)
from dehyst.daemon.loop.settings import LoopSettings
from dehyst.daemon.loop.targets import TrajectoryQueue
from dehyst.daemon.rings.records import COMMAND, TELEMETRY, State
from dehyst.models.addresses import Addresses
from dehyst.models.inverse.compensator import Compensator, CompensatorState
from dehyst.models.learning import trim

NAN = float("nan")


class Stepper:
    """The controller's state and its step.

    volts: the output as last written. `record`: a (1,) TELEMETRY array that each step fills
    (the loop adds times, I/O figures and missed deadlines). `table`: addresses of all arrays, for
    the kernels. `events`: messages about what happened, until a caller clears them.
    """

    def __init__(
        self,
        settings: LoopSettings,
        compensator: Compensator,
        volts: float,
        trimmed: NDArray[Any] | None = None,
    ) -> None:
        """trimmed: (1,) SETTING of dehyst.models.learning.trim; None: no trim, no learning."""
        self.settings = settings
        self.queue = TrajectoryQueue(settings.queue_points)
        self.record = np.zeros(1, TELEMETRY)
        self.control = np.zeros(1, CONTROL_T)
        self.trim = trim.begin_trim()
        no_trim = trim.make_trim_setting(settings.period_ns * 1e-9, 0.0, 0.0, on=False)
        self.trim_setting = no_trim if trimmed is None else trimmed
        self.events: list[str] = []
        self._numbers = settings.record()
        self._notes = np.zeros(NOTES, NOTE_T)
        self._reported = 0
        self._channels: dict[str, float] = {}
        self._commands = np.zeros(COMMANDS_PER_SAMPLE, COMMAND)
        self.table = Addresses(records_in_memory.N_TABLE)
        for place, array in (
            (records_in_memory.SETTINGS, self._numbers),
            (records_in_memory.CONTROL, self.control),
            (records_in_memory.QUEUE, self.queue.numbers),
            (records_in_memory.TIMES, self.queue.times),
            (records_in_memory.VALUES, self.queue.values),
            (records_in_memory.CORRECTIONS, self.queue.corrections),
            (records_in_memory.TRIM_SETTING, self.trim_setting),
            (records_in_memory.TRIM, self.trim),
            (records_in_memory.NOTE_RING, self._notes),
            (records_in_memory.COMMANDS, self._commands),
            (records_in_memory.RECORD, self.record),
        ):
            self.table.put(place, array)
        c = self.control
        c["state"], c["volts"], c["target"] = State.READY, volts, NAN
        c["hold_ns"] = settings.hold_ns
        c["move_ns"], c["found"] = settings.period_ns, 1
        self.use(compensator, compensator.init(volts / settings.gain))

    def use(self, compensator: Compensator, inverse: CompensatorState) -> None:
        """Use this compensator in this state; call it before the first sample."""
        self.fill_channels(compensator, inverse)
        self.taken(compensator, inverse)
        self.control["inverse"] = inverse.address
        self.control["predicted"] = inverse.reading - self.settings.origin

    def fill_channels(self, compensator: Compensator, inverse: CompensatorState) -> None:
        """Fill an inverse's channels with the newest measured values, before it is used."""
        for i, name in enumerate(compensator.channels):
            inverse.channels[i] = self._channels.get(name, NAN)

    # -- requests from outside the sample -----------------------------------------------------

    def stop(self, now_ns: int) -> None:
        """Begin to stop: the output goes to its configured state."""
        step_kernel.stop(self.table.words, now_ns)

    @property
    def stopped(self) -> bool:
        """Return True when the output has reached its state for the daemon's end."""
        return bool(step_kernel.stopped(self.table.words, 0))

    def fault(self, now_ns: int, text: str) -> None:
        """Handle a failed device: drop targets and write no voltage until `recover`."""
        step_kernel.fault(self.table.words, now_ns)
        self.events.append(text)

    def recover(self, now_ns: int, volts: float) -> None:
        """Continue after a failure: the devices are back and the output is at `volts`."""
        step_kernel.recover(self.table.words, now_ns, volts)

    def reload(self, compensator: Compensator, inverse: CompensatorState, origin: float) -> None:
        """Use another model, its state already led along the past drive, without an output jump."""
        self.fill_channels(compensator, inverse)
        step_kernel.swap(self.table.words, inverse.address, origin)
        self.taken(compensator, inverse)

    def follow(self, rows: NDArray[Any]) -> None:
        """Let channels of the inverse in use follow other axes: (n,) FOLLOW_T."""
        self.table.put(records_in_memory.FOLLOWS, rows)

    def taken(self, compensator: Compensator, inverse: CompensatorState) -> None:
        """Note that the kernels use this inverse now; the previous one may be freed."""
        self.compensator, self.inverse = compensator, inverse

    # -- one sample ---------------------------------------------------------------------------

    def step(self, now_ns: int, measured: float, commands: NDArray[Any]) -> NDArray[Any]:
        """Process one sample at the grid point now_ns; return the (1,) record.

        measured: sensor reading as model displacement, NaN where invalid; commands: COMMAND
        records that arrived.
        """
        if commands.size > self._commands.size:
            self._commands = np.zeros(commands.size, COMMAND)
            self.table.put(records_in_memory.COMMANDS, self._commands)
        if commands.size:
            self._commands[: commands.size] = commands
        step_kernel.take_step(self.table.words, now_ns, measured, commands.size)
        self.collect_events()
        return self.record

    def measured(self, name: str, value: float) -> None:
        """Store a new value of a further channel of the model. May be called from any thread."""
        self._channels[name] = value
        for i, known in enumerate(self.compensator.channels):
            if known == name:
                self.inverse.channels[i] = value

    def follow_output(self, volts: float) -> None:
        """Advance the model by the applied output `volts`."""
        step_kernel.follow_output(self.table.words, volts)

    def collect_events(self) -> None:
        """Convert the kernels' notes to messages in `events`."""
        made = int(self.control["notes"][0])
        if made == self._reported:
            return
        lost = made - self._reported - NOTES
        unit = self.compensator.model.displacement_unit
        for number in range(max(self._reported, made - NOTES), made):
            code, value = self._notes[number % NOTES].item()
            self.events.append(describe_note(code, value, unit))
        if lost > 0:
            self.events.append(f"{lost} further events in the same moment")
        self._reported = made

    # -- properties ---------------------------------------------------------------------------

    @property
    def volts(self) -> float:
        """Return the output as last written [V]."""
        return float(self.control["volts"][0])

    @property
    def origin(self) -> float:
        """Return the model displacement at set-point 0."""
        return float(self._numbers["origin"][0])

    @property
    def state(self) -> State:
        """Return the state of the controller."""
        return State(int(self.control["state"][0]))

    @property
    def trajectory(self) -> int:
        """Return the id of the trajectory being played or played last; 0: none."""
        return int(self.control["trajectory"][0])

    @property
    def trajectory_done(self) -> bool:
        """Return True when that trajectory has been played to its end."""
        return bool(self.control["trajectory_done"][0])
