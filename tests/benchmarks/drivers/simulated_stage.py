"""Cost of the simulated stage per step: python -m tests.benchmarks.drivers.simulated_stage"""

import math
import sys
import time

import numpy as np
from tests.benchmarks.bars import Bars, too_busy

from dehyst.drivers.simulated.axes import compile_stage
from dehyst.drivers.simulated.stage import SimulatedStage

STEPS = 20_000


MOST_US = 50.0
"""A tenth of the period of a 2 kHz loop with the stage in its own process."""


def main() -> int:
    """Print a table: microseconds per step, one call at a time and as an array."""
    busy, bars = too_busy(), Bars()
    compile_stage()
    SimulatedStage().run(np.arange(2) * 1e-3, np.zeros(2))
    print("period_us  advance+reading_us  run_us")
    for period_s in (1e-2, 1e-3, 1e-4):
        t = np.arange(STEPS) * period_s
        volts = 75.0 - 70.0 * np.cos(2 * math.pi * 3.0 * t)
        stage = SimulatedStage()
        start = time.perf_counter()
        for v in volts:
            stage.advance(period_s, v)
            stage.reading_um()
        single = (time.perf_counter() - start) / STEPS * 1e6
        stage = SimulatedStage()
        start = time.perf_counter()
        stage.run(t, volts)
        whole = (time.perf_counter() - start) / STEPS * 1e6
        print(f"{period_s * 1e6:9.0f}  {single:18.1f}  {whole:6.1f}")
        name = f"one step of {1e6 * period_s:g} us"
        if busy:
            bars.cannot(name, busy)
        else:
            bars.most(name, single, MOST_US, "us")
    return bars.end()


if __name__ == "__main__":
    sys.exit(main())
