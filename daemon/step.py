"""One sample of the controller, without clock, device or bus: inputs in, record out.

    admit commands -> state -> target window -> inverse -> bump, range, slew -> record

What each state does to the voltage stands in dehyst.daemon.records.State. The sensor is read
before the voltage is written: a voltage is made for the target one period on, and `predicted` is
what the model expected of the reading in the same record. Everything here is deterministic: the
same inputs give the same records, which is how recorded runs are replayed in the tests. Targets
and displacements count from the set-point origin, voltages are the actuator's.
"""

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np

from dehyst.daemon.config import Config
from dehyst.daemon.records import TELEMETRY, Command, Flag, Mode, State
from dehyst.daemon.targets import TrajectoryQueue
from dehyst.models import compensator as comp
from dehyst.models.compensator import Compensator, CompensatorState

NAN = float("nan")
# walls against nonsense that passed the gateway; what is reachable is the inverse's to say
LARGEST_TARGET = 1e6
LONGEST_OFFSET_NS = 10**9 * 86_400 * 365

_MODES = {
    comp.HOLD: Mode.HOLD,
    comp.STATIC: Mode.STATIC,
    comp.CAUSAL: Mode.CAUSAL,
    comp.PREVIEW: Mode.PREVIEW,
}
_FLAGS = {
    comp.FLAG_BEYOND_SATURATION: Flag.UNREACHABLE,
    comp.FLAG_BEYOND_DRIVE: Flag.UNREACHABLE,
    comp.FLAG_SLEW: Flag.SLEW,
    comp.FLAG_STARVED: Flag.FALLBACK,
    comp.FLAG_BAD_TARGET: Flag.UNREACHABLE,
    comp.FLAG_OUTSIDE_VALIDITY: Flag.OUTSIDE_VALIDITY,
}


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


class Stepper:
    """The controller's state and its step.

    volts: the output as last written. `record`: a (1,) TELEMETRY array that each step fills
    (times, I/O figures and missed deadlines are the loop's to add).
    """

    def __init__(self, plan: Plan, compensator: Compensator, volts: float) -> None:
        self.plan = plan
        self.compensator = compensator
        self.inverse = compensator.init(volts / plan.gain)
        self.volts = volts
        self.bump = 0.0
        self.state = State.READY
        self.queue = TrajectoryQueue(plan.queue_points)
        self.record = np.zeros(1, TELEMETRY)
        self.events: list[str] = []
        self._window = np.zeros(compensator.window_samples + 1)
        self._channels = np.zeros(len(compensator.channels))
        self._target = NAN  # newest target, from the origin; NaN: none
        self._target_ns = 0  # when it was last confirmed by a client
        self._since_ns = 0  # when the present state began
        self._hold_ns = plan.hold_ns
        self._starved = False
        self.trajectory = 0
        self.trajectory_done = False
        self.approach_until_ns = 0
        self._predicted = float(self.inverse.result[comp.READING]) - plan.origin

    # -- requests from outside the sample's journey -------------------------------------------

    def stop(self, now_ns: int) -> None:
        """Begin to end: the output goes to its configured state."""
        if self.state is not State.STOPPING:
            self._enter(State.STOPPING, now_ns)

    @property
    def stopped(self) -> bool:
        """True when the output has reached its state at the end of the daemon."""
        return self.state is State.STOPPING and (
            not self.plan.ramp_on_stop or self.volts == self.plan.safe_v
        )

    def fault(self, now_ns: int, text: str) -> None:
        """A device failed: drop targets, no further voltage until `recovered`."""
        if self.state not in (State.FAULT, State.STOPPING):
            self._drop_targets()
            self._enter(State.FAULT, now_ns)
        self.events.append(text)

    def recovered(self, now_ns: int, volts: float) -> None:
        """The devices are back and the output stands at `volts`."""
        self.volts = volts
        self.compensator.applied(self.inverse, volts / self.plan.gain)
        if self.state is State.FAULT:
            self._hold_ns = 0 if self.plan.ramp_on_fault else self.plan.hold_ns
            self._enter(State.HOLDING if self.plan.ramp_on_fault else State.READY, now_ns)

    def reload(self, compensator: Compensator, inverse: CompensatorState, origin: float) -> None:
        """Another model, its state already led along the past drive; the output does not jump."""
        self.compensator, self.inverse = compensator, inverse
        self.plan = replace(self.plan, origin=origin)
        self._window = np.zeros(compensator.window_samples + 1)
        self._channels = np.zeros(len(compensator.channels))
        self.bump = NAN  # taken from the first voltage of the new model

    # -- one sample ---------------------------------------------------------------------------

    def step(
        self,
        now_ns: int,
        measured: float,
        commands: np.ndarray,
        channels: Mapping[str, float] | None = None,
    ) -> np.ndarray:
        """Take one sample at the grid point now_ns; returns the (1,) record.

        measured: sensor reading as model displacement, NaN where invalid; commands: COMMAND
        records that arrived; channels: further measured channels by name.
        """
        plan, record = self.plan, self.record[0]
        flags = Flag(0)
        if commands.size:
            self._admit(now_ns, commands)
        self._age(now_ns)
        wanted, mode, target = self.volts, Mode.HOLD, NAN
        if self.state is State.RUNNING:
            wanted, mode, target, flags = self._follow(now_ns, channels)
        elif self.state is State.HOLDING:
            target = self._target
            if now_ns - self._since_ns >= self._hold_ns:
                target = NAN
                wanted = self._ramp()
                if wanted == plan.safe_v == self.volts:
                    self._drop_targets()
                    self._enter(State.READY, now_ns)
        elif self.state is State.STOPPING and plan.ramp_on_stop:
            wanted = self._ramp()
        elif self.state is State.READY:
            mode = Mode.NONE
        volts, limited = self._limit(wanted)
        flags |= limited
        if np.isnan(measured):
            flags |= Flag.SENSOR_INVALID
        record["target"] = target
        record["measured"] = measured - plan.origin
        record["predicted"] = self._predicted
        record["volts_raw"] = wanted
        record["volts"] = volts
        record["flags"] = flags
        record["state"] = self.state
        record["mode"] = mode
        return self.record

    def written(self, volts: float) -> None:
        """The output now stands at `volts`; the model follows what was really applied."""
        self.volts = volts
        self.compensator.applied(self.inverse, volts / self.plan.gain)
        self._predicted = float(self.inverse.result[comp.READING]) - self.plan.origin

    # -- parts --------------------------------------------------------------------------------

    def _enter(self, state: State, now_ns: int) -> None:
        self.state, self._since_ns = state, now_ns
        self.bump = 0.0

    def _drop_targets(self) -> None:
        self.queue.clear()
        self._target = NAN

    def _position(self) -> float:
        """Where the model says the stage is now."""
        return float(self.inverse.result[comp.PREDICTED]) - self.plan.origin

    def _admit(self, now_ns: int, commands: np.ndarray) -> None:
        for kind, last, trajectory, offset_ns, value in zip(
            commands["kind"].tolist(),
            commands["last"].tolist(),
            commands["trajectory"].tolist(),
            commands["offset_ns"].tolist(),
            commands["value"].tolist(),
            strict=True,
        ):
            if self.state in (State.FAULT, State.STOPPING, State.START):
                continue  # the gateway has refused these with words; late ones are dropped here
            if not abs(value) <= LARGEST_TARGET or not abs(offset_ns) <= LONGEST_OFFSET_NS:
                self.events.append(f"set-point {value:g} dropped: not a number a stage can follow")
                continue
            if kind == Command.SETPOINT:
                self._setpoint(now_ns, value)
            elif kind == Command.POINT:
                self._point(now_ns, trajectory, offset_ns, value, bool(last))
            elif kind == Command.CLEAR and trajectory == self.queue.id:
                self._hold(now_ns, self.plan.hold_ns, "trajectory withdrawn by its client")
            elif kind == Command.STOP_MOTION:
                self._hold(now_ns, self.plan.hold_ns, "stopped by a client")
            elif kind == Command.RELEASE:
                self._hold(now_ns, 0, "released by a client: ramping to the safe voltage")

    def _setpoint(self, now_ns: int, value: float) -> None:
        moving = self.state is State.RUNNING
        self._target_ns = now_ns
        if moving and not self.queue.active:
            self._target = value
            return
        start = self._target if moving and not np.isnan(self._target) else self._position()
        self._approach(now_ns, start, value)
        self.queue.complete = True
        self._target = value
        if not moving:
            self._enter(State.RUNNING, now_ns)

    def _point(
        self, now_ns: int, trajectory: int, offset_ns: int, value: float, last: bool
    ) -> None:
        self._target_ns = now_ns
        if trajectory != self.queue.id or not self.queue.active:
            moving = self.state is State.RUNNING and not np.isnan(self._target)
            start = self._target if moving else self._position()
            self._approach(now_ns, start, value, trajectory, offset_ns, last)
            self.trajectory, self.trajectory_done = trajectory, False
            if self.state is not State.RUNNING:
                self._enter(State.RUNNING, now_ns)
        elif not self.queue.append(offset_ns, value, last):
            self.events.append(
                f"trajectory point at {offset_ns * 1e-9:.3f} s dropped: "
                + ("the queue is full" if self.queue.full else "its time is not after the last")
            )

    def _approach(
        self,
        now_ns: int,
        start: float,
        value: float,
        trajectory: int = 0,
        offset_ns: int = 0,
        last: bool = False,
    ) -> None:
        """Queue the way from `start` to a trajectory's first point at the approach speed."""
        way_ns = max(
            self.plan.period_ns, round(abs(value - start) / self.plan.approach_um_per_s * 1e9)
        )
        self.queue.begin(trajectory, now_ns + way_ns - offset_ns)
        self.queue.append(offset_ns - way_ns, start, False)
        self.queue.append(offset_ns, value, last)
        self.approach_until_ns = now_ns + way_ns

    def _hold(self, now_ns: int, hold_ns: int, why: str) -> None:
        if self.state is State.RUNNING or (self.state is State.HOLDING and hold_ns == 0):
            self.events.append(why)
            self.queue.clear()
            self._hold_ns = hold_ns
            self._enter(State.HOLDING, now_ns)
        elif self.state is State.READY and hold_ns == 0 and self.volts != self.plan.safe_v:
            self._hold_ns = 0
            self._enter(State.HOLDING, now_ns)

    def _age(self, now_ns: int) -> None:
        """Trajectories that end or run dry, set-points that go stale."""
        if self.state is not State.RUNNING:
            return
        queue = self.queue
        if queue.finished(now_ns):
            self._target, self._target_ns = (
                float(self._last_value()),
                max(self._target_ns, queue.end_ns),
            )
            if queue.id:
                self.trajectory_done = True
            queue.clear()
        starved = queue.starved(now_ns)
        if starved and not self._starved:
            self._target_ns = now_ns
            self.events.append("the trajectory has run dry: holding its last target")
        elif self._starved and not starved and queue.active:
            self.bump = NAN
        self._starved = starved
        if (starved or not queue.active) and now_ns - self._target_ns > self.plan.stale_ns:
            self.events.append(
                f"no set-point for {self.plan.stale_ns * 1e-9:g} s: holding, "
                f"then to the safe voltage"
            )
            queue.clear()
            self._hold_ns = self.plan.hold_ns
            self._enter(State.HOLDING, now_ns)

    def _last_value(self) -> float:
        self.queue.window(self.queue.end_ns, self.plan.period_ns, self._window)
        return float(self._window[0])

    def _follow(
        self, now_ns: int, channels: Mapping[str, float] | None
    ) -> tuple[float, Mode, float, Flag]:
        """The inverse's voltage for the present target."""
        flags = Flag(0)
        known = 1
        if self.queue.active:
            known = self.queue.window(now_ns, self.plan.period_ns, self._window)
            if known:
                self._target = float(self._window[0])
            if now_ns < self.approach_until_ns:
                flags |= Flag.APPROACH
        if not self.queue.active or known < 2:
            self._window[:] = self._target
            if self.queue.active:
                flags |= Flag.FALLBACK
            known = 2
        self._window += self.plan.origin
        for i, name in enumerate(self.compensator.channels):
            self._channels[i] = NAN if channels is None else channels.get(name, NAN)
        # the voltage written now is judged by the next reading, one period on
        self.compensator.step(self.inverse, self._window[1:], known - 1, self._channels)
        result = self.inverse.result
        volts = float(result[comp.DRIVE]) * self.plan.gain
        if self.bump:
            if np.isnan(self.bump):
                self.bump = self.volts - volts
            decay = self.plan.ramp_v_per_s * self.plan.period_ns * 1e-9
            self.bump -= float(np.clip(self.bump, -decay, decay))
        bits = int(result[comp.FLAGS])
        for bit, flag in _FLAGS.items():
            if bits & bit:
                flags |= flag
        return volts + self.bump, _MODES[int(result[comp.MODE])], self._target, flags

    def _ramp(self) -> float:
        """One step from the present output towards the safe voltage."""
        step = self.plan.ramp_v_per_s * self.plan.period_ns * 1e-9
        return self.volts + float(np.clip(self.plan.safe_v - self.volts, -step, step))

    def _limit(self, wanted: float) -> tuple[float, Flag]:
        """Range and slew: the last wall before the amplifier."""
        plan, flags = self.plan, Flag(0)
        if not np.isfinite(wanted):
            return self.volts, Flag.RANGE
        volts = min(max(wanted, plan.min_v), plan.max_v)
        if volts != wanted:
            flags |= Flag.RANGE
        step = plan.slew_v_per_s * plan.period_ns * 1e-9
        limited = min(max(volts, self.volts - step), self.volts + step)
        if limited != volts:
            flags |= Flag.SLEW
        return limited, flags
