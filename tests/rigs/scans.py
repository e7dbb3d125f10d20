"""Scan a trajectory repeatedly on the simulated stage, in this process, with trim and learning, and
report the true error of each pass."""

from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np
from tests.rigs.trimmed_stage import Player, Tamper, TrimmedStage

from dehyst.daemon.rings.records import TELEMETRY, Flag
from dehyst.drivers.simulated.settings import StageSettings
from dehyst.models.learning.passes import Learner, Pass, fade_share
from dehyst.models.learning.reading import expected_reading
from dehyst.models.learning.tuning import TUNING
from dehyst.models.model import Floats, Model

PERIOD_S = 1e-3
MISSING = np.zeros(1, TELEMETRY)
MISSING["measured"], MISSING["flags"] = np.nan, Flag.MISSED


def sine(hertz: float, peak_to_peak: float, seconds: float = 1.0) -> Floats:
    """Return a pass of whole periods about 8 um."""
    t = PERIOD_S * np.arange(round(seconds / PERIOD_S))
    return 8.0 - 0.5 * peak_to_peak * np.cos(2.0 * np.pi * hertz * t)


def raster(lines: float = 5.0, peak_to_peak: float = 4.0) -> Floats:
    """Return lines back and forth in a second, with turns rounded over 30 ms."""
    t = PERIOD_S * np.arange(1000)
    triangle = np.abs(2.0 * np.mod(lines * t, 1.0) - 1.0) * peak_to_peak
    k = np.hanning(33)[1:-1]
    return 6.0 + np.convolve(np.tile(triangle, 3), k / k.sum(), "same")[1000:2000]


def staircase() -> Floats:
    """Return five levels up and down, 0.2 s each, with moves of 20 ms."""
    levels = np.repeat([4.0, 6.0, 8.0, 10.0, 12.0, 10.0, 8.0, 6.0], 200)
    k = np.hanning(22)[1:-1]
    return np.convolve(np.tile(levels, 3), k / k.sum(), "same")[levels.size : 2 * levels.size]


@dataclass
class Scan:
    """The results of each pass: std and mean of the true error [nm], the learning's report, largest
    step of the voltage; and everything that the loop reported."""

    std_nm: list[float] = field(default_factory=list)
    mean_nm: list[float] = field(default_factory=list)
    said: list[str] = field(default_factory=list)
    step_v: list[float] = field(default_factory=list)
    correction_um: list[float] = field(default_factory=list)
    events: list[str] = field(default_factory=list)
    rig: TrimmedStage | None = None


def scan(
    model: Model,
    target: Floats,
    passes: int,
    stage: StageSettings | None = None,
    trim: bool = True,
    tamper: Callable[[int], Tamper | None] = lambda number: None,
    missed: Callable[[int], frozenset[int]] = lambda number: frozenset(),
    learn: bool = True,
) -> Scan:
    """Play `target` this often. tamper, missed: disturbances in pass number 0, 1 ..."""
    rig = TrimmedStage(model, stage, trim)
    player, out = Player(rig), Scan(rig=rig)
    noise = model.fit.noise_rms or 0.02
    learner = Learner(target, PERIOD_S, noise, 0.1 * (rig.reach[1] - rig.reach[0]))
    expected = expected_reading(model, target, PERIOD_S)
    share = fade_share(np.arange(target.size), round(TUNING.fade_s / PERIOD_S))
    old = learner.correction
    for number in range(passes):
        used = old + share * (learner.correction - old) * learn
        old = learner.correction * learn
        own = player.play(target, used, tamper(number), missed=missed(number))
        rows = [MISSING[0] if row is None else row for row in rig.records[own]]
        records = np.array(rows, TELEMETRY)
        error = 1e3 * (np.array(rig.true[own]) - target)
        bad = (records["flags"] & int(Flag.SENSOR_INVALID | Flag.MISSED)) != 0
        measured = np.where(bad, np.nan, records["measured"])
        outcome = learner.take(Pass(measured - expected, used, trim))
        out.std_nm.append(float(error.std()))
        out.mean_nm.append(float(error.mean()))
        out.said.append(outcome.says)
        volts = records["volts"][~((records["flags"] & int(Flag.MISSED)) != 0)]
        out.step_v.append(float(np.abs(np.diff(volts)).max()))
        out.correction_um.append(float(np.abs(learner.correction).max()))
    out.events = list(rig.stepper.events)
    return out
