"""The controller's step with a clock that the test controls, and every voltage that it wrote."""

import numpy as np

from dehyst.daemon.config import parse_config
from dehyst.daemon.loop.settings import LoopSettings
from dehyst.daemon.loop.step import Stepper
from dehyst.daemon.rings.records import COMMAND, LoopCommand, State
from dehyst.models.inverse.compensator import Compensator
from dehyst.models.model import Hysteresis, Model, Validity

PERIOD_NS = 1_000_000
SLEW, MIN_V, MAX_V, GAIN = 2000.0, 0.0, 75.0, 7.5
CONFIG = """
name = "bench"
[model]
file = "none"
[actuator]
driver = "simulated"
gain = 7.5
[sensor]
driver = "simulated"
[limits]
min_v = 0
max_v = 75
slew_v_per_s = 2000
[safe]
voltage_v = 3.0
ramp_v_per_s = 40.0
"""


def model(scale: float = 1.0) -> Model:
    r = 10 * (np.arange(8) / 8) ** 2 / 2
    b = np.r_[0.8, np.full(7, 0.05)] * scale
    return Model(Hysteresis(r=r, b=b, c=[0.0, 1.0]), Validity(0.0, 10.0))


def compensator(of: Model) -> Compensator:
    return Compensator(of, PERIOD_NS * 1e-9, MIN_V / GAIN, MAX_V / GAIN, SLEW / GAIN)


class Bench:
    """A stepper, its clock, and every voltage that it wrote."""

    def __init__(self, volts: float = 0.0, config: str = CONFIG, origin: float = 0.0) -> None:
        self.settings = LoopSettings.from_config(parse_config(config), origin, MIN_V, MAX_V, 1.0)
        self.stepper = Stepper(self.settings, compensator(model()), volts)
        self.now = 0
        self.volts = [volts]

    def tick(self, *commands: tuple[LoopCommand, float], n: int = 1) -> np.void:
        batch = np.zeros(len(commands), COMMAND)
        for row, (kind, value) in zip(batch, commands, strict=True):
            row["kind"], row["value"] = kind, value
        return self.send(batch, n)

    def send(self, batch: np.ndarray, n: int = 1) -> np.void:
        for i in range(n):
            self.now += PERIOD_NS
            record = self.stepper.step(self.now, 1.0, batch if i == 0 else batch[:0])[0]
            if self.stepper.state is not State.FAULT:
                self.stepper.follow_output(float(record["volts"]))
            self.volts.append(self.stepper.volts)
        return self.stepper.record[0].copy()


def points(trajectory: int, values: list[float], first: int, last: bool) -> np.ndarray:
    batch = np.zeros(len(values), COMMAND)
    batch["kind"], batch["trajectory"] = LoopCommand.POINT, trajectory
    batch["offset_ns"] = (first + np.arange(len(values))) * PERIOD_NS
    batch["value"] = values
    batch["last"][-1:] = last
    return batch
