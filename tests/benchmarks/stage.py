"""Cost of the simulated stage per step: python tests/benchmarks/stage.py"""

import math
import time

import numpy as np

from dehyst.drivers.stage import Stage, warm_up

STEPS = 20_000


def main() -> None:
    """Print a table: microseconds a step, one call at a time and as an array."""
    warm_up()
    Stage().run(np.arange(2) * 1e-3, np.zeros(2))
    print("period_us  advance+reading_us  run_us")
    for period_s in (1e-2, 1e-3, 1e-4):
        t = np.arange(STEPS) * period_s
        volts = 75.0 - 70.0 * np.cos(2 * math.pi * 3.0 * t)
        stage = Stage()
        start = time.perf_counter()
        for v in volts:
            stage.advance(period_s, v)
            stage.reading_um()
        single = (time.perf_counter() - start) / STEPS * 1e6
        stage = Stage()
        start = time.perf_counter()
        stage.run(t, volts)
        whole = (time.perf_counter() - start) / STEPS * 1e6
        print(f"{period_s * 1e6:9.0f}  {single:18.1f}  {whole:6.1f}")


if __name__ == "__main__":
    main()
