"""One sample of the controller, without clock, bus or device: the kernels' face in Python.

What each state does to the voltage stands in dehyst.daemon.rings.records.State, the rules
themselves in dehyst.daemon.loop.step_kernel. The sensor is read before the voltage is written: a
voltage is made for the target one period on, and `predicted` is what the model expected of the
reading in the same record. Everything here is deterministic: the same inputs give the same records,
which is how recorded runs are replayed in the tests. Targets and displacements count from the
set-point origin, voltages are the actuator's.
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
from dehyst.drivers.direct_calls import Addresses
from dehyst.models.inverse.compensator import Compensator, CompensatorState
from dehyst.models.learning import trim

NAN = float("nan")


class Stepper:
    """The controller's state and its step.

    volts: the output as last written. `record`: a (1,) TELEMETRY array that each step fills
    (times, I/O figures and missed deadlines are the loop's to add). `table`: the addresses of
    everything, for the kernels. `events`: what happened, in words, until somebody clears them.
    """

    def __init__(
        self,
        settings: LoopSettings,
        compensator: Compensator,
        volts: float,
        trimmed: NDArray[Any] | None = None,
    ) -> None:
        """trimmed: (1,) SETTING of dehyst.models.learning.trim; None: no trim, nothing learned."""
        self.settings = settings
        self.queue = TrajectoryQueue(settings.queue_points)
        self.record = np.zeros(1, TELEMETRY)
        self.control = np.zeros(1, CONTROL_T)
        self.trim = trim.begin_trim()
        no_trim = trim.setting_of(settings.period_ns * 1e-9, 0.0, 0.0, on=False)
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
        c["state"], c["volts"], c["target"], c["hold_ns"] = (
            State.READY,
            volts,
            NAN,
            settings.hold_ns,
        )
        c["move_ns"], c["found"] = settings.period_ns, 1
        self.use(compensator, compensator.init(volts / settings.gain))

    def use(self, compensator: Compensator, inverse: CompensatorState) -> None:
        """Take this compensator in this state, before the first sample."""
        self.fill_channels(compensator, inverse)
        self.taken(compensator, inverse)
        self.control["inverse"] = inverse.address
        self.control["predicted"] = inverse.reading - self.settings.origin

    def fill_channels(self, compensator: Compensator, inverse: CompensatorState) -> None:
        """Make an inverse ready to be taken: channels as measured last."""
        for i, name in enumerate(compensator.channels):
            inverse.channels[i] = self._channels.get(name, NAN)

    # -- requests from outside the sample's journey -------------------------------------------

    def stop(self, now_ns: int) -> None:
        """Begin to end: the output goes to its configured state."""
        step_kernel.stop(self.table.words, now_ns)

    @property
    def stopped(self) -> bool:
        """True when the output has reached its state at the end of the daemon."""
        return bool(step_kernel.stopped(self.table.words, 0))

    def fault(self, now_ns: int, text: str) -> None:
        """A device failed: drop targets, no further voltage until `recover`."""
        step_kernel.fault(self.table.words, now_ns)
        self.events.append(text)

    def recover(self, now_ns: int, volts: float) -> None:
        """The devices are back and the output stands at `volts`."""
        step_kernel.recover(self.table.words, now_ns, volts)

    def reload(self, compensator: Compensator, inverse: CompensatorState, origin: float) -> None:
        """Another model, its state already led along the past drive; the output does not jump."""
        self.fill_channels(compensator, inverse)
        step_kernel.swap(self.table.words, inverse.address, origin)
        self.taken(compensator, inverse)

    def follow(self, rows: NDArray[Any]) -> None:
        """Let channels of the inverse in use follow other axes: (n,) FOLLOW_T."""
        self.table.put(records_in_memory.FOLLOWS, rows)

    def taken(self, compensator: Compensator, inverse: CompensatorState) -> None:
        """The kernels use this inverse now; the one before may go."""
        self.compensator, self.inverse = compensator, inverse

    # -- one sample ---------------------------------------------------------------------------

    def step(
        self,
        now_ns: int,
        measured: float,
        commands: NDArray[Any],
    ) -> NDArray[Any]:
        """Take one sample at the grid point now_ns; returns the (1,) record.

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
        """A further channel of the model was read, from any thread; it stands until the next."""
        self._channels[name] = value
        for i, known in enumerate(self.compensator.channels):
            if known == name:
                self.inverse.channels[i] = value

    def follow_output(self, volts: float) -> None:
        """The output now stands at `volts`; the model follows what was really applied."""
        step_kernel.follow_output(self.table.words, volts)

    def collect_events(self) -> None:
        """Put what the kernels noted into `events`, in words."""
        made = int(self.control["notes"][0])
        if made == self._reported:
            return
        lost = made - self._reported - NOTES
        for number in range(max(self._reported, made - NOTES), made):
            code, value = self._notes[number % NOTES].item()
            self.events.append(describe_note(code, value))
        if lost > 0:
            self.events.append(f"{lost} further events in the same moment")
        self._reported = made

    # -- what can be seen ---------------------------------------------------------------------

    @property
    def volts(self) -> float:
        """The output as last written [V]."""
        return float(self.control["volts"][0])

    @property
    def origin(self) -> float:
        """Model displacement at set-point 0."""
        return float(self._numbers["origin"][0])

    @property
    def state(self) -> State:
        """What the controller is doing."""
        return State(int(self.control["state"][0]))

    @property
    def trajectory(self) -> int:
        """Id of the trajectory being played or played last; 0: none."""
        return int(self.control["trajectory"][0])

    @property
    def trajectory_done(self) -> bool:
        """True when that trajectory has been played to its end."""
        return bool(self.control["trajectory_done"][0])
