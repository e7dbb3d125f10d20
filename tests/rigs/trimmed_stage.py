"""A controller on the simulated stage in this process, sample by sample in virtual time: with trim,
with learned corrections, and with faults of the gauge."""

from collections.abc import Callable, Collection
from typing import Any

import numpy as np

from dehyst.daemon.config import parse_config
from dehyst.daemon.loop.checks import REPLAY_SAMPLES
from dehyst.daemon.loop.settings import LoopSettings
from dehyst.daemon.loop.step import Stepper
from dehyst.daemon.loop.trim import trim_setting
from dehyst.daemon.rings.records import COMMAND, TELEMETRY, LoopCommand
from dehyst.drivers.simulated.settings import StageSettings
from dehyst.drivers.simulated.stage import SimulatedStage
from dehyst.models.cascade.reach import displacement_range
from dehyst.models.inverse.compensator import Compensator
from dehyst.models.model import Floats, Model

LOW_V, HIGH_V, SLEW = 0.0, 150.0, 4000.0
CONFIG = """
name = "trimmed"
model = {{file = "none"}}
loop = {{rate_hz = {rate_hz}}}
actuator = {{driver = "simulated"}}
sensor = {{driver = "simulated"}}
limits = {{min_v = {low}, max_v = {high}, slew_v_per_s = {slew}}}
setpoint = {{origin = 0.0, stale_s = 1e6, queue_s = 600.0}}
trim = {{enabled = {trim}}}
"""

Tamper = Callable[["TrimmedStage", float], float]
"""(rig, reading) -> the reading that the loop gets; may also change the stage."""


class TrimmedStage:
    """One controller and its stage. `records`: (n,) TELEMETRY of all samples; `true_um`: (n,) true
    position of the stage at each reading."""

    def __init__(
        self,
        model: Model,
        stage: StageSettings | None = None,
        trim: bool = True,
        rate_hz: float = 1000.0,
        slew: float = SLEW,
    ) -> None:
        text = CONFIG.format(
            rate_hz=rate_hz, low=LOW_V, high=HIGH_V, slew=slew, trim=str(trim).lower()
        )
        config = self._config = parse_config(text)
        self.period_ns, self._slew = config.period_ns, slew
        valid = model.validity
        low, high = max(LOW_V, valid.drive_min), min(HIGH_V, valid.drive_max)
        least, most = displacement_range(model, low, high)
        self.reach = least, most
        slope = (most - least) / (high - low)
        compensator = Compensator(model, config.period_ns * 1e-9, LOW_V, HIGH_V, slew)
        self.stepper = Stepper(
            LoopSettings.from_config(config, 0.0, LOW_V, HIGH_V, slope),
            compensator,
            0.0,
            trim_setting(config, model, most - least),
        )
        self.stage = SimulatedStage(stage)
        self.now_ns = 0
        self.records: list[Any] = []
        self.true: list[float] = []

    def tick(self, commands: np.ndarray, tamper: Tamper | None = None) -> None:
        """Run one sample: read, step, write, let a period pass."""
        stepper = self.stepper
        reading = self.stage.reading_um()
        self.true.append(self.stage.displacement_um)
        if tamper is not None:
            reading = tamper(self, reading)
        if self.records and self.records[-1] is None:
            stepper.follow_output(stepper.volts)  # the model accounts for the time that passed
        record = stepper.step(self.now_ns, reading, commands)[0].copy()
        record["seq"], record["scheduled_ns"] = len(self.records), self.now_ns
        self.records.append(record)
        self.stage.advance(self.period_ns * 1e-9, float(record["volts"]))
        stepper.follow_output(float(record["volts"]))
        self.now_ns += self.period_ns

    def reload(self, model: Model, unseen: int = 0) -> None:
        """Load another model as the loop does: replay the past output on it, except the newest
        samples, which pass during the replay."""
        period_s = self.period_ns * 1e-9
        compensator = Compensator(model, period_s, LOW_V, HIGH_V, self._slew)
        seen = len(self.records) - unseen
        past = [float(r["volts"]) for r in self.records[max(0, seen - REPLAY_SAMPLES) : seen]]
        state = compensator.init(past[0])
        for volts in past:
            compensator.applied(state, volts)
        least, most = self.reach
        self.stepper.reload(compensator, state, self.stepper.origin)
        self.stepper.trim_setting[:] = trim_setting(self._config, model, most - least)

    def skip(self) -> None:
        """Miss a sample: a period passes under the previous voltage."""
        self.records.append(None)
        self.true.append(self.stage.displacement_um)
        self.stage.advance(self.period_ns * 1e-9)
        self.now_ns += self.period_ns

    def go(self, um: float, seconds: float, tamper: Tamper | None = None) -> None:
        """Go to a set-point and stay there."""
        command = np.zeros(1, COMMAND)
        command["kind"], command["value"] = LoopCommand.SETPOINT, um
        for i in range(round(seconds * 1e9 / self.period_ns)):
            self.tick(command if i == 0 else command[:0], tamper)

    def play(
        self,
        target: Floats,
        correction: Floats | None = None,
        tamper: Tamper | None = None,
        number: int = 1,
    ) -> slice:
        """Play a whole trajectory, a point a period, after the approach; return its slice."""
        player = Player(self, number)
        return player.play(target, correction, tamper, last=True)

    @property
    def telemetry(self) -> np.ndarray:
        return np.array(self.records, TELEMETRY)

    @property
    def true_um(self) -> Floats:
        return np.array(self.true)


class Player:
    """Streams one trajectory in pieces that follow one another without a gap."""

    def __init__(self, rig: TrimmedStage, number: int = 1) -> None:
        self.rig, self.number, self.sent, self.begun = rig, number, 0, -1

    def play(
        self,
        target: Floats,
        correction: Floats | None = None,
        tamper: Tamper | None = None,
        last: bool = False,
        missed: Collection[int] = (),
    ) -> slice:
        """Play the next piece; return its slice of samples. missed: indices in it that the loop
        misses."""
        rig, n = self.rig, target.size
        batch = np.zeros(n, COMMAND)
        batch["kind"], batch["trajectory"] = LoopCommand.POINT, self.number
        batch["offset_ns"] = (self.sent + np.arange(n)) * rig.period_ns
        batch["value"] = target
        batch["correction"] = 0.0 if correction is None else correction
        batch["last"][-1] = last
        if self.sent == 0:
            rig.tick(batch[:1], tamper)
            rig.tick(batch[1:], tamper)
            while rig.records[-1]["flags"] & 1024:
                rig.tick(batch[:0], tamper)
            self.begun = len(rig.records) - 1
            done = 1
        else:
            rig.tick(batch, tamper)
            done = 1
        first = self.begun + self.sent
        for place in range(done, n):
            if place in missed:
                rig.skip()
            else:
                rig.tick(batch[:0], tamper)
        self.sent += n
        return slice(first, first + n)
