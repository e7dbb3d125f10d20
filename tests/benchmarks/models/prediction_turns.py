"""Turns: drives with corners, which no recording of smooth drives contains, and the stage itself
tracked by the inverse; parts of tests.benchmarks.models.prediction."""

from collections.abc import Sequence

import numpy as np
from tests.benchmarks.bars import Bars
from tests.benchmarks.models import prediction_cases as cases

from dehyst.models.cascade.simulate import simulate
from dehyst.models.identify import identify
from dehyst.models.inverse.compensator import Compensator
from dehyst.models.inverse.offline import invert_streamed
from dehyst.models.model import Model
from dehyst.models.recording import Floats

NM, NOISE = 1e3, 0.045
TEN, TWO = cases.times(10.0), cases.times(2.0)
MOST_V = 0.19  # per sample, of the staircase: nearly the largest rate of the recordings
APPROACH = 200  # samples


def measure_corners(seeds: Sequence[int], bars: Bars) -> None:
    """Predict corners at up to the largest rate, which the recordings never had at a turn."""
    run, models = cases.paper().run, _identify(seeds)
    for what, u in {
        "triangle, 75 V/s": cases.triangle(TEN, 0.0, 7.5, 5.0),
        "triangle, 195 V/s": cases.triangle(TEN, 0.0, 7.5, 13.0),
        "small triangle, 160 V/s": cases.triangle(TEN, 2.0, 6.0, 20.0),
        "staircase, 190 V/s": _staircase(),
    }.items():
        want = run(u)
        found = NM * max(cases.rms(simulate(m, cases.T_S, u) - want) for m in models)
        print(f"{what}: {found:.1f} nm", flush=True)
        bars.most(f"with corners, {what}", found, 25.0, "nm")


def measure_tracking(seeds: Sequence[int], bars: Bars) -> None:
    """Track the stage with a preview of 100 ms, to within the noise of one reading."""
    run, models = cases.paper().run, _identify(seeds)
    for what, target in (
        ("sine, 1 Hz", cases.sines(TWO, (3.375, 1))),
        ("sine, 5 Hz", cases.sines(TWO, (2.25, 5))),
        ("sine, 10 Hz", cases.sines(TWO, (1.5, 10))),
        ("sine, 20 Hz", cases.sines(TWO, (0.75, 20))),
        ("triangle, 10 Hz", cases.triangle(TWO, 0.0, 3.0, 10.0)),
    ):
        target = target - 0.5 * np.ptp(target) + 4.3
        errors = []
        for model in models:
            comp = Compensator(model, cases.T_S, 0.0, 10.0, 1e4, "preview", 0.1)
            drive = np.r_[0.0, invert_streamed(comp, target).drive]
            errors.append(cases.rms((run(drive)[1:] - target)[APPROACH:]))
        print(f"{what}, {np.ptp(target):.2f} um: {NM * max(errors):.1f} nm", flush=True)
        bars.most(f"tracked, {what}", NM * max(errors), NM * NOISE, "nm")


def _identify(seeds: Sequence[int]) -> list[Model]:
    """Return models of the paper's two sines with Eq. 12 as the stage."""
    u = cases.sines(TEN, (2, 10), (3, 5))
    return [identify([cases.record(cases.paper().run, u, NOISE, s)]).model for s in seeds]


def _staircase() -> Floats:
    """Return (N,) 200 random levels, each reached at nearly the largest rate."""
    levels = np.repeat(np.random.default_rng(3).uniform(1.0, 7.0, 200), TEN.size // 200)
    u = np.zeros(TEN.size)
    for t in range(1, u.size):
        u[t] = u[t - 1] + min(max(levels[t] - u[t - 1], -MOST_V), MOST_V)
    return u
