"""Separate the causes of the residual error when learning through a serial amplifier.

    python -m tests.benchmarks.daemon.learning_times [--passes N]

The simulated stage runs at 200 Hz in this process, with the output set and the gauge read as long
after the deadline as by the emulated MDT693B and KSG101. The variants are with and without their
jitter, the stage with and without its 780 Hz mode, the gauge with and without its filter of 150 us,
and its filter declared or not. Printed is the standard deviation of the true error, of the first
pass and (median) of the last ones; for the last ones also the part that repeats from pass to pass.
"""

import argparse
import sys
from typing import NamedTuple

import numpy as np
from tests.rigs.trimmed_stage import Player, Tamper, TrimmedStage

from dehyst.daemon.bench.simulated import RATE_HZ, simulated_model
from dehyst.drivers.simulated.settings import StageSettings
from dehyst.models.learning.late_gauge import LateGauge
from dehyst.models.learning.passes import Learner, Pass, fade_share
from dehyst.models.learning.reading import expected_reading
from dehyst.models.learning.tuning import TUNING
from dehyst.models.model import Floats, Model

SINES = ((1.0, 8.0), (5.0, 6.0))
SETTLED = 12  # passes
FILTER_S = 150e-6
BOUND = 0.1  # share of the reach, the same bound as in the loop


class Times(NamedTuple):
    """Delays after the deadline [s], and the random part added to them, uniform from 0."""

    reading_s: float = 0.45e-3
    output_s: float = 1.95e-3
    reading_jitter_s: float = 0.1e-3
    output_jitter_s: float = 0.3e-3


class LateStage(TrimmedStage):
    """The controller on a stage whose gauge is read, and output set, after the deadline."""

    def __init__(self, model: Model, stage: StageSettings, times: Times) -> None:
        super().__init__(model, stage, rate_hz=RATE_HZ)
        self.times, self.chance = times, np.random.default_rng(1)
        self.read_s: list[float] = []
        self.set_s: list[float] = []

    def tick(self, commands: np.ndarray, tamper: Tamper | None = None) -> None:
        """Run one sample."""
        times, stage, period_s = self.times, self.stage, self.period_ns * 1e-9
        read_s = times.reading_s + times.reading_jitter_s * self.chance.random()
        set_s = times.output_s + times.output_jitter_s * self.chance.random()
        self.read_s.append(self.now_ns * 1e-9)  # telemetry has only this time
        self.set_s.append(self.now_ns * 1e-9 + set_s)
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


def outputs_before(rig: LateStage, own: slice, back: int) -> tuple[Floats, Floats]:
    """Return (n, back) output steps before each reading of a pass, and the time since each."""
    volts = np.array([float(record["volts"]) for record in rig.records[: own.stop]])
    at = np.maximum(np.arange(own.start, own.stop)[:, None] - np.arange(1, back + 1), 1)
    read_s, set_s = np.array(rig.read_s), np.array(rig.set_s)
    return volts[at] - volts[at - 1], read_s[own, None] - set_s[at]


def learned(
    rig: LateStage, model: Model, target: Floats, passes: int, filter_s: float = 0.0
) -> Floats:
    """Return (passes, n) true errors [nm]. filter_s: as declared, 0 if not declared."""
    late = LateGauge(filter_s)
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
        error = measured - expected
        if filter_s:
            error = error + late.take(error - used, *outputs_before(rig, own, late.back))
        learner.take(Pass(error, used, True, late.anew))
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
        "filter declared": (StageSettings(), Times()),
        "filter declared, on time": (StageSettings(), on_time),
        "on time": (StageSettings(), on_time),
        "gauge without filter": (no_filter, Times()),
        "gauge without filter, on time": (no_filter, on_time),
        "stage without mode": (no_mode, Times()),
    }
    t_s = np.arange(round(RATE_HZ)) / RATE_HZ
    for hertz, um in SINES:
        target = 8.0 - 0.5 * um * np.cos(2.0 * np.pi * hertz * t_s)
        for name, (stage, times) in cases.items():
            declared = FILTER_S if "declared" in name else 0.0
            rig = LateStage(model, stage, times)
            error = learned(rig, model, target, args.passes, declared)
            last = error[SETTLED:]
            text = f"{error[0].std():.0f} to {np.median(last.std(axis=1)):.1f} nm"
            repeats = f"{last.mean(axis=0).std():.1f} nm of it repeats"
            print(f"{um:g} um at {hertz:g} Hz, {name}: {text}, {repeats}")
    return 0


if __name__ == "__main__":
    sys.exit(main())
