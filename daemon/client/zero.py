"""Compares gauge and model, at rest or while the stage is moved slowly."""

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from dehyst.daemon import clock
from dehyst.daemon.client.client import Client
from dehyst.daemon.rings.records import Flag
from dehyst.models.errors import NotNow

REST_S = 2.0  # of telemetry, averaged against noise and hum
PATIENCE_S = 10.0  # for these REST_S to arrive
PLACES = 3  # lower, middle and upper part of the motion
POINTS_PER_S = 50.0  # of the slow motion; the daemon interpolates
MOVED = 10.0  # times the rms of the difference: a smaller way has no separate places


@dataclass(frozen=True)
class Place:
    """Mean difference while the model's displacement is between low and high."""

    low: float
    high: float
    mean: float


@dataclass(frozen=True)
class Disagreement:
    """Gauge minus model, overall and per position range. samples: how many were compared."""

    mean: float
    places: tuple[Place, ...]
    samples: int


def differences(samples: NDArray[Any]) -> Disagreement:
    """Compare gauge and model in (n,) TELEMETRY records; all position ranges have equal weight."""
    unusable = int(Flag.SENSOR_INVALID | Flag.SENSOR_HELD)
    good = (samples["flags"] & unusable) == 0
    good &= np.isfinite(samples["measured"]) & np.isfinite(samples["predicted"])
    at, off = samples["predicted"][good], (samples["measured"] - samples["predicted"])[good]
    if not off.size:
        return Disagreement(0.0, (), 0)
    low, high = float(at.min()), float(at.max())
    edges = np.linspace(low, high, PLACES + 1)
    moved = high - low > MOVED * float(off.std())
    if not moved:
        mean = float(off.mean())
        return Disagreement(mean, (Place(low, high, mean),), int(off.size))
    of = np.clip(np.searchsorted(edges, at, side="right") - 1, 0, PLACES - 1)
    places = tuple(
        Place(float(edges[i]), float(edges[i + 1]), float(off[of == i].mean()))
        for i in range(PLACES)
        if np.any(of == i)
    )
    return Disagreement(float(np.mean([p.mean for p in places])), places, int(off.size))


def compare_zero(client: Client) -> Disagreement:
    """Listen for REST_S without moving anything. Raises NotNow if no telemetry arrives."""
    stream = client.stream()
    parts: list[NDArray[Any]] = []
    begun_ns = clock.monotonic_ns()
    period_s = client.status().period_ns * 1e-9
    wanted = round(REST_S / period_s)
    try:
        while sum(part.size for part in parts) < wanted:
            parts.append(stream.read(0.2))
            if clock.monotonic_ns() - begun_ns > PATIENCE_S * 1e9:
                break
    finally:
        stream.close()
    samples = np.concatenate(parts)
    if not samples.size:
        raise NotNow("the daemon sends no telemetry: is its loop running?")
    return differences(samples)


def exercise_and_compare(client: Client, share: float, seconds: float) -> Disagreement:
    """Cycle twice through `share` of the reach, `seconds` per cycle, and compare in the second
    cycle. The stage ends at the low end of that range. Raises NotNow, Refusal, BusError."""
    status = client.status()
    middle = 0.5 * (status.reach_min + status.reach_max)
    half = 0.5 * share * (status.reach_max - status.reach_min)
    t_s = np.arange(round(2 * seconds * POINTS_PER_S) + 1) / POINTS_PER_S
    target = middle - half * np.cos(2.0 * np.pi * t_s / seconds)
    parts: list[NDArray[Any]] = []
    client.play(t_s, target, on_samples=parts.append)
    if not parts:
        raise NotNow("no telemetry arrived while the stage was exercised")
    samples: NDArray[Any] = np.concatenate(parts)
    own = np.isfinite(samples["target"]) & ((samples["flags"] & int(Flag.APPROACH)) == 0)
    samples = samples[own]
    return differences(samples[samples.size // 2 :])
