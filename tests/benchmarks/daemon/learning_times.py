"""What is left when learning through a serial amplifier, taken apart in this process.

    python -m tests.benchmarks.daemon.learning_times [--passes N]

The simulated stage at 200 Hz, the output set and the gauge read as long after the deadline as by
the emulated MDT693B and KSG101, with their jitter and without, the stage with its 780 Hz mode and
without, the gauge with its filter of 150 us and without. Standard deviation of the true error, of
the first pass and (median) of the last ones; of these also what repeats from pass to pass.
"""

import argparse
import sys
from typing import NamedTuple

import numpy as np
from tests.rigs.trimmed_stage import Player, Tamper, TrimmedStage

from dehyst.daemon.tools.bench_config import RATE_HZ, simulated_model
from dehyst.drivers.simulated.settings import StageSettings
from dehyst.models.learning.passes import Learner, Pass, fade_share
from dehyst.models.learning.reading import expected_reading
from dehyst.models.learning.tuning import TUNING
from dehyst.models.model import Floats, Model

SINES = ((1.0, 8.0), (5.0, 6.0))
SETTLED = 12  # passes
BOUND = 0.1  # of the reach, as the loop bounds it


class Times(NamedTuple):
    """After the deadline [s], and what chance adds, uniform from 0 to it."""

    reading_s: float = 0.45e-3
    output_s: float = 1.95e-3
    reading_jitter_s: float = 0.1e-3
    output_jitter_s: float = 0.3e-3


class LateStage(TrimmedStage):
    """The controller on a stage whose gauge is read, and output set, after the deadline."""

    def __init__(self, model: Model, stage: StageSettings, times: Times) -> None:
        super().__init__(model, stage, rate_hz=RATE_HZ)
        self.times, self.chance = times, np.random.default_rng(1)

    def tick(self, commands: np.ndarray, tamper: Tamper | None = None) -> None:
        """One sample."""
        times, stage, period_s = self.times, self.stage, self.period_ns * 1e-9
        read_s = times.reading_s + times.reading_jitter_s * self.chance.random()
        set_s = times.output_s + times.output_jitter_s * self.chance.random()
        stage.advance(read_s)
        reading = stage.reading_um()
        self.true.append(stage.displacement_um)
        record = self.stepper.step(self.now_ns, reading, commands)[0].copy()
        record["seq"], record["scheduled_ns"] = len(self.records), self.now_ns
        self.records.append(record)
        stage.advance(set_s - read_s)
        stage.advance(period_s - set_s, float(record["volts"]))
        self.stepper.follow_output(float(record["volts"]))
        self.now_ns += self.period_ns


def learned(rig: LateStage, model: Model, target: Floats, passes: int) -> Floats:
    """(passes, n) true errors [nm]."""
    period_s, player, out = 1.0 / RATE_HZ, Player(rig), []
    reach_um = rig.reach[1] - rig.reach[0]
    learner = Learner(target, period_s, model.fit.noise_rms or 0.02, BOUND * reach_um)
    expected = expected_reading(model, target, period_s)
    share = fade_share(np.arange(target.size), round(TUNING.fade_s / period_s))
    old = learner.correction
    for _ in range(passes):
        used = old + share * (learner.correction - old)
        old = learner.correction
        own = player.play(target, used)
        measured = np.array([float(record["measured"]) for record in rig.records[own]])
        learner.take(Pass(measured - expected, used, True))
        out.append(1e3 * (np.array(rig.true[own]) - target))
    return np.array(out)


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0] if __doc__ else "")
    parser.add_argument("--passes", type=int, default=24)
    args = parser.parse_args()
    model, on_time = simulated_model(), Times(reading_jitter_s=0.0, output_jitter_s=0.0)
    no_filter, no_mode = StageSettings(sensor_tau_s=0.0), StageSettings(mode_share=0.0)
    cases = {
        "as it is": (StageSettings(), Times()),
        "on time": (StageSettings(), on_time),
        "gauge without filter": (no_filter, Times()),
        "gauge without filter, on time": (no_filter, on_time),
        "stage without mode": (no_mode, Times()),
    }
    t_s = np.arange(round(RATE_HZ)) / RATE_HZ
    for hertz, um in SINES:
        target = 8.0 - 0.5 * um * np.cos(2.0 * np.pi * hertz * t_s)
        for name, (stage, times) in cases.items():
            error = learned(LateStage(model, stage, times), model, target, args.passes)
            last = error[SETTLED:]
            text = f"{error[0].std():.0f} to {np.median(last.std(axis=1)):.1f} nm"
            repeats = f"{last.mean(axis=0).std():.1f} nm of it repeats"
            print(f"{um:g} um at {hertz:g} Hz, {name}: {text}, {repeats}")
    return 0


if __name__ == "__main__":
    sys.exit(main())
