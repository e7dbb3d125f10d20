"""Faulty recordings."""

import os
from collections.abc import Iterator
from pathlib import Path

import numpy as np
from tests.benchmarks.models import identify_cases as cases

from dehyst.models.hysteresis.forward import simulate_hysteresis
from dehyst.models.model import Hysteresis
from dehyst.models.recording import Recording


def data_folder(root: Path) -> Path | None:
    """Return the folder with recordings/, or None."""
    folder = Path(os.environ.get("DEHYST_DATA") or root.parent / "shared")
    return folder if (folder / "recordings").is_dir() else None


def recordings(truth: Hysteresis, seed: int = 5) -> Iterator[tuple[str, Recording]]:
    """Yield (what is wrong, recording) of the paper's two sines."""
    rng = np.random.default_rng(seed)
    u = cases.two_sines()
    t = np.arange(u.size) * cases.T_S
    y = simulate_hysteresis(truth, u, cases.T_S) + 0.045 * rng.standard_normal(u.size)
    some = rng.choice(u.size, u.size // 100, replace=False)
    gone = np.zeros(u.size, dtype=bool)
    gone[rng.choice(u.size, u.size // 20, replace=False)] = True
    yield "sound", Recording(t, u, y)
    wild = y.copy()
    wild[some] += rng.choice([-1, 1], some.size) * rng.uniform(0.5, 20.0, some.size)
    yield "1 % outliers", Recording(t, u, wild)
    zeros = y.copy()
    zeros[some] = 0.0
    yield "1 % zeros", Recording(t, u, zeros)
    spikes = u.copy()
    spikes[some] += rng.choice([-1, 1], some.size) * rng.uniform(0.02, 10.0, some.size)
    yield "1 % drive spikes", Recording(t, spikes, y)
    yield "5 % rows missing", Recording(t[~gone], u[~gone], y[~gone])
    yield "5 % readings NaN", Recording(t, u, np.where(gone, np.nan, y))
    yield "5 % drive NaN", Recording(t, np.where(gone, np.nan, u), y)
    yield "stamps jitter 30 %", Recording(t + rng.uniform(-0.3, 0.3, t.size) * cases.T_S, u, y)
    yield "reversed sign", Recording(t, u, -y)
    yield "starts in mid-motion", Recording(t[:-333], u[333:], y[333:])
    yield "constant voltage", Recording(t, np.full(u.size, 3.0), y)
    ramp = np.linspace(0.0, 7.5, u.size)
    yield "single ramp", Recording(t, ramp, simulate_hysteresis(truth, ramp, cases.T_S))
    yield "nothing moves", Recording(t, u, 0.045 * rng.standard_normal(u.size))
    yield "dead sensor", Recording(t, u, np.zeros(u.size))
    yield "three lines", Recording(t[:3], u[:3], y[:3])
