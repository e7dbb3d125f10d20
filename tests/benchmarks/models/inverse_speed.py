"""Speed of the inverse, as ratios within one run; see tests.benchmarks.models.inverse."""

import ctypes
import shutil
import subprocess
import tempfile
import time
from collections.abc import Callable
from functools import partial
from pathlib import Path

import numpy as np
from scipy.optimize import brentq
from tests.benchmarks.bars import Bars
from tests.rigs.random_models import NEVER, driven

from dehyst.models.arrays import Floats
from dehyst.models.hysteresis.monotone import nearest_monotone
from dehyst.models.inverse.compensator import Compensator
from dehyst.models.inverse.static import StaticInverse, static_inverse
from dehyst.models.modelfile import shipped

REPEATS = 25
BAR_C = 2.0  # times the duration of a C -O3 walk
BARS_PREVIEW = {1000: 5.0, 10_000: 15.0}  # % of a core, by rate


def _best(work: Callable[[], object], clock: Callable[[], float] = time.perf_counter) -> float:
    best = np.inf
    for _ in range(REPEATS):
        began = clock()
        work()
        best = min(best, clock() - began)
    return float(best)


def _compiled() -> ctypes.CDLL | None:
    compiler = shutil.which("gcc") or shutil.which("cc") or shutil.which("clang")
    if compiler is None:
        return None
    folder = Path(tempfile.mkdtemp())
    source, library = Path(__file__).with_name("breakpoint_walk.c"), folder / "walk.so"
    command = [compiler, "-O3", "-march=native", "-shared", "-fPIC", str(source), "-o",
               str(library), "-lm"]  # fmt: skip
    if subprocess.run(command, check=False).returncode:
        return None
    return ctypes.CDLL(str(library))


def _in_c(library: ctypes.CDLL, inverse: StaticInverse, y: Floats) -> Floats:
    s = inverse.branch
    h, u = np.zeros(inverse.r.size), np.empty(y.size)

    def at(array: Floats) -> ctypes.c_void_p:
        return ctypes.c_void_p(array.ctypes.data)

    d = ctypes.c_double
    library.invert(
        at(inverse.r), at(inverse.b), inverse.r.size, at(s.c), s.c.size, at(s.z_knots),
        s.z_knots.size, d(s.y_first), d(s.y_last), d(inverse.drive_min), d(inverse.drive_max),
        at(h), at(y), at(u), y.size,
    )  # fmt: skip
    return u


def _with_brentq(inverse: StaticInverse, y: Floats) -> Floats:
    """Invert by a root finder on the numpy forward model, one sample at a time."""
    h, u = np.zeros(inverse.r.size), np.empty(y.size)
    r, b, powers = inverse.r, inverse.b, inverse.branch.c[::-1]
    for t in range(y.size):

        def miss(v: float, t: int = t, h: Floats = h) -> float:
            return float(np.polyval(powers, b @ np.maximum(v - r, np.minimum(v + r, h))) - y[t])

        u[t] = brentq(miss, inverse.drive_min, inverse.drive_max, xtol=1e-12)
        h = np.maximum(u[t] - r, np.minimum(u[t] + r, h))
    return u


def table(bars: Bars) -> None:
    """Print the ratios."""
    print("\nspeed (best of repeats, one process)")
    model, _ = nearest_monotone(shipped("paper-eq12"))
    inverse = static_inverse(model)
    y = 6.0 + 3.5 * np.sin(np.arange(100_000) * 0.013) * np.cos(np.arange(100_000) * 0.00031)
    inverse.run(y[:10])
    ours = _best(lambda: inverse.run(y)) / y.size
    print(f"static inverse, n = {inverse.r.size}: {1e9 * ours:.0f} ns a sample")
    library = _compiled()
    if library is None:
        bars.cannot("static inverse over C -O3", "no C compiler")
    else:
        c = _best(lambda: _in_c(library, inverse, y)) / y.size
        difference = float(np.max(np.abs(_in_c(library, inverse, y) - inverse.run(y)[0])))
        print(
            f"C -O3 breakpoint walk: {1e9 * c:.0f} ns; dehyst / C = {ours / c:.2f} (bar "
            f"{BAR_C:g}); drives differ by {difference:.1g} V"
        )
        bars.most("static inverse over C -O3", ours / c, BAR_C)
    few = y[:200]
    slow = _best(lambda: _with_brentq(inverse, few)) / few.size
    print(
        f"brentq on the numpy forward model: {1e6 * slow:.0f} us; brentq / dehyst = "
        f"{slow / ours:.0f}"
    )
    bars.least("brentq over the static inverse", slow / ours, 500.0)
    for rate_hz, bar in BARS_PREVIEW.items():
        for mode in ("static", "causal", "preview"):
            share, took = _mode(mode, rate_hz)
            print(
                f"{mode} at {rate_hz} Hz: {100 * share:.1f} % of one core in a compiled loop"
                + (f" (bar {bar:g} %)" if mode == "preview" else "")
                + f"; called from Python: median {1e6 * np.median(took):.1f} us, 99 % below "
                f"{1e6 * np.quantile(took, 0.99):.0f} us",
                flush=True,
            )
            if mode == "preview":
                bars.most(f"preview at {rate_hz} Hz, share of one core", 100 * share, bar, "%")


def _mode(mode: str, rate_hz: int) -> tuple[float, Floats]:
    """Return the share of a core in a compiled loop, and seconds per sample from Python."""
    c = Compensator(shipped("paper-eq12"), 1 / rate_hz, 0.0, 10.0, 1e4, mode, 0.1)
    n = 2 * rate_hz
    target = 6.0 - 3.0 * np.cos(2 * np.pi * 5 * np.arange(n) / rate_hz)
    driven(c, target[: n // 10], NEVER, 0.0)
    share = _best(partial(driven, c, target, NEVER, 0.0), time.thread_time) / 2.0
    state, nothing = c.init(0.0), np.zeros(0)
    took = np.empty(n - c.window_samples)
    for i in range(took.size):
        began = time.perf_counter()
        c.step(state, target[i : i + c.window_samples], c.window_samples, nothing)
        c.applied(state, state.drive)
        took[i] = time.perf_counter() - began
    return share, took
