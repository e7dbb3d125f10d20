"""One sample of the controller, without clock, bus or device: the kernels' face in Python.

What each state does to the voltage stands in dehyst.daemon.records.State, the rules themselves in
dehyst.daemon.step_kernel. The sensor is read before the voltage is written: a voltage is made for
the target one period on, and `predicted` is what the model expected of the reading in the same
record. Everything here is deterministic: the same inputs give the same records, which is how
recorded runs are replayed in the tests. Targets and displacements count from the set-point origin,
voltages are the actuator's.
"""

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from dehyst.daemon import controls, step_kernel
from dehyst.daemon.config import Config
from dehyst.daemon.controls import COMMANDS_PER_SAMPLE, CONTROL_T, NOTE_T, NOTES, PLAN_T, words
from dehyst.daemon.records import COMMAND, TELEMETRY, State
from dehyst.daemon.targets import TrajectoryQueue
from dehyst.drivers.direct import Addresses
from dehyst.models import compensator as comp
from dehyst.models.compensator import Compensator, CompensatorState

NAN = float("nan")


@dataclass(frozen=True)
class Plan:
    """The numbers of a run, from configuration, model and device limits; volts at the actuator."""

    period_ns: int
    gain: float
    min_v: float
    max_v: float
    slew_v_per_s: float
    safe_v: float
    ramp_v_per_s: float
    ramp_on_stop: bool
    ramp_on_fault: bool
    stale_ns: int
    hold_ns: int
    approach_um_per_s: float
    queue_points: int
    origin: float

    @classmethod
    def from_config(cls, config: Config, origin: float, min_v: float, max_v: float) -> "Plan":
        """min_v, max_v: the tighter of the configured limits and the unit's own."""
        return cls(
            period_ns=config.period_ns,
            gain=config.actuator.gain,
            min_v=min_v,
            max_v=max_v,
            slew_v_per_s=config.limits.slew_v_per_s,
            safe_v=min(max(config.safe.voltage_v, min_v), max_v),
            ramp_v_per_s=config.safe.ramp_v_per_s,
            ramp_on_stop=config.safe.on_stop == "ramp",
            ramp_on_fault=config.safe.on_fault == "ramp",
            stale_ns=round(config.setpoint.stale_s * 1e9),
            hold_ns=round(config.setpoint.hold_s * 1e9),
            approach_um_per_s=config.setpoint.approach_um_per_s,
            queue_points=max(65536, round(1.5 * config.setpoint.queue_s * config.loop.rate_hz)),
            origin=origin,
        )

    def numbers(self) -> NDArray[Any]:
        """The plan as the kernels read it: a (1,) PLAN_T array."""
        record = np.zeros(1, PLAN_T)
        for name in PLAN_T.names or ():
            if name in ("slew_v", "ramp_v"):
                record[name] = getattr(self, f"{name}_per_s") * self.period_ns * 1e-9
            else:
                record[name] = getattr(self, name)
        return record


def inverse_table(compensator: Compensator, state: CompensatorState) -> Addresses:
    """A compensator and its state as the kernels read them; both live in the same arrays."""
    table = Addresses(controls.N_INVERSE)
    packed = compensator._packed
    arrays = {
        controls.WEIGHTS: compensator._weights,
        controls.C: compensator._c,
        controls.KNOTS: compensator._knots,
        controls.FIXED: compensator._fixed,
        controls.SETTING: compensator._setting,
        controls.BLOCKS: packed.table,
        controls.PARAMS: packed.params,
        controls.NUMBERS: state.numbers,
        controls.PLAYS: state.plays,
        controls.WORK: state.work,
        controls.STATES: state.blocks,
        controls.SCRATCH: state.scratch,
        controls.INNER: state.inner,
        controls.PAST_RING: state.ring,
        controls.SEQ: state.seq,
        controls.Y: state.y,
        controls.CHANNELS: state.channels,
        controls.RESULT: state.result,
        controls.WINDOW: np.zeros(compensator.window_samples + 1),
    }
    for place, array in arrays.items():
        table.put(place, array)
    return table


class Stepper:
    """The controller's state and its step.

    volts: the output as last written. `record`: a (1,) TELEMETRY array that each step fills
    (times, I/O figures and missed deadlines are the loop's to add). `table`: the addresses of
    everything, for the kernels. `events`: what happened, in words, until somebody clears them.
    """

    def __init__(self, plan: Plan, compensator: Compensator, volts: float) -> None:
        self.plan = plan
        self.queue = TrajectoryQueue(plan.queue_points)
        self.record = np.zeros(1, TELEMETRY)
        self.control = np.zeros(1, CONTROL_T)
        self.events: list[str] = []
        self._numbers = plan.numbers()
        self._notes = np.zeros(NOTES, NOTE_T)
        self._told = 0
        self._channels: dict[str, float] = {}
        self._commands = np.zeros(COMMANDS_PER_SAMPLE, COMMAND)
        self.table = Addresses(controls.N_TABLE)
        for place, array in (
            (controls.PLAN, self._numbers),
            (controls.CONTROL, self.control),
            (controls.QUEUE, self.queue.numbers),
            (controls.TIMES, self.queue.times),
            (controls.VALUES, self.queue.values),
            (controls.NOTE_RING, self._notes),
            (controls.COMMANDS, self._commands),
            (controls.RECORD, self.record),
        ):
            self.table.put(place, array)
        c = self.control
        c["state"], c["volts"], c["target"], c["hold_ns"] = State.READY, volts, NAN, plan.hold_ns
        self.use(compensator, compensator.init(volts / plan.gain))

    def use(self, compensator: Compensator, inverse: CompensatorState) -> None:
        """Take this compensator in this state, before the first sample."""
        self.compensator, self.inverse = compensator, inverse
        self._inverse = self.prepared(compensator, inverse)
        self.control["inverse"] = self._inverse.address
        self.control["predicted"] = float(inverse.result[comp.READING]) - self.plan.origin

    def prepared(self, compensator: Compensator, inverse: CompensatorState) -> Addresses:
        """An inverse ready to be taken, channels as measured last; it lives as long as it is
        kept."""
        for i, name in enumerate(compensator.channels):
            inverse.channels[i] = self._channels.get(name, NAN)
        return inverse_table(compensator, inverse)

    # -- requests from outside the sample's journey -------------------------------------------

    def stop(self, now_ns: int) -> None:
        """Begin to end: the output goes to its configured state."""
        step_kernel.stop(self.table.words, now_ns)

    @property
    def stopped(self) -> bool:
        """True when the output has reached its state at the end of the daemon."""
        return bool(step_kernel.stopped(self.table.words, 0))

    def fault(self, now_ns: int, text: str) -> None:
        """A device failed: drop targets, no further voltage until `recovered`."""
        step_kernel.fault(self.table.words, now_ns)
        self.events.append(text)

    def recovered(self, now_ns: int, volts: float) -> None:
        """The devices are back and the output stands at `volts`."""
        step_kernel.recovered(self.table.words, now_ns, volts)

    def reload(self, compensator: Compensator, inverse: CompensatorState, origin: float) -> None:
        """Another model, its state already led along the past drive; the output does not jump."""
        table = self.prepared(compensator, inverse)
        step_kernel.swap(self.table.words, table.address, origin)
        self.taken(compensator, inverse, table)

    def taken(self, compensator: Compensator, inverse: CompensatorState, table: Addresses) -> None:
        """The kernels use this inverse now; the one before may go."""
        self.compensator, self.inverse, self._inverse = compensator, inverse, table

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
            self.table.put(controls.COMMANDS, self._commands)
        if commands.size:
            self._commands[: commands.size] = commands
        step_kernel.step(self.table.words, now_ns, measured, commands.size)
        self.tell()
        return self.record

    def measured(self, name: str, value: float) -> None:
        """A further channel of the model was read, from any thread; it stands until the next."""
        self._channels[name] = value
        for i, known in enumerate(self.compensator.channels):
            if known == name:
                self.inverse.channels[i] = value

    def written(self, volts: float) -> None:
        """The output now stands at `volts`; the model follows what was really applied."""
        step_kernel.written(self.table.words, volts)

    def tell(self) -> None:
        """Put what the kernels noted into `events`, in words."""
        made = int(self.control["notes"][0])
        if made == self._told:
            return
        lost = made - self._told - NOTES
        for number in range(max(self._told, made - NOTES), made):
            code, value = self._notes[number % NOTES].item()
            self.events.append(words(code, value))
        if lost > 0:
            self.events.append(f"{lost} further events in the same moment")
        self._told = made

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
