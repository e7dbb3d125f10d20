"""Check whether a drive shows enough of a stage to identify it: range, rates, loop sizes,
repetitions, rest.

A rate-dependent model of hysteresis needs every part of the drive range at slow and fast rates, up
and down, and loops of several sizes. One sine ties the rate to the drive: then a rate-dependent
loop and a loop of another shape cannot be distinguished.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numba import njit
from numpy.typing import NDArray

from dehyst.models.errors import BadRecording
from dehyst.models.identify.data.outliers import sample
from dehyst.models.recording import Floats, Recording, typical_step
from dehyst.models.units import spell_unit

SIZE_EDGES = (0.02, 0.15, 0.4, 0.7, 1.01)  # classes of loop sizes, relative to the span


class Tuning(NamedTuple):
    """Rules of thumb, checked by tests/models/drive_design; no benchmark has set them."""

    drive_bins: int = 8
    rate_bins: int = 9
    enough_cells: float = 0.55  # of drive and rate cells for a rate-dependent model
    enough_sizes: int = 3  # of the four classes of loop sizes
    fewest_cycles: float = 3.0
    steps_per_span: float = 40.0  # fewer samples per sweep through the range hide small loops
    still: float = 1e-3  # of the largest rate: slower counts as rest


TUNING = Tuning()


@dataclass(frozen=True)
class Coverage:
    """What a drive covers.

    cells: (drive_bins, rate_bins) number of samples by drive and rate; drive_edges, rate_edges: of
    the cells; sizes: (K,) size of each travel between turns, as a share of the span; covered: share
    of the cells that hold samples; cycles: full travels back and forth; rest_s: time at rest;
    missing, missing_rate: sentences on what is missing for a static and for a rate-dependent model.
    """

    cells: Floats
    drive_edges: Floats
    rate_edges: Floats
    sizes: Floats
    covered: float
    cycles: float
    rest_s: float
    rate_max: float
    missing: tuple[str, ...]
    missing_rate: tuple[str, ...]

    @property
    def span(self) -> float:
        """Drive range covered."""
        return float(self.drive_edges[-1] - self.drive_edges[0])


@njit(cache=True, nogil=True)
def _list_travels(u: Floats, least: float) -> Floats:
    """Return the sizes of the travels between turns; wiggles smaller than `least` do not count as
    turns."""
    out = np.empty(u.size)
    count = 0
    start = extreme = u[0]
    up = 0
    for i in range(u.size):
        x = u[i]
        if up >= 0 and x > extreme:
            extreme, up = x, 1
        elif up <= 0 and x < extreme:
            extreme, up = x, -1
        elif abs(x - extreme) > least:
            if abs(extreme - start) > least:
                out[count] = abs(extreme - start)
                count += 1
            start, extreme = extreme, x
            up = 1 if x > start else -1
    if abs(extreme - start) > least:
        out[count] = abs(extreme - start)
        count += 1
    return out[:count].copy()


@njit(cache=True, nogil=True)
def _count(
    u: Floats, rates: Floats, low: float, high: float, rate_max: float, cells: Floats
) -> None:
    """Add the samples to the cells of drive and rate; rates beyond rate_max are not counted."""
    bins, rate_bins = cells.shape
    for i in range(rates.size):
        if abs(rates[i]) <= rate_max:
            a = int((u[i + 1] - low) / (high - low) * bins)
            b = int((rates[i] + rate_max) / (2.0 * rate_max) * rate_bins)
            cells[min(a, bins - 1), min(b, rate_bins - 1)] += 1.0


def measure_coverage(recordings: Sequence[Recording]) -> Coverage:
    """Return what the drives of these recordings cover together. Raises BadRecording for a drive
    that does not move."""
    known = [slice(None) if not r.missing_drive.any() else ~r.missing_drive for r in recordings]
    drives = [r.drive[k] for r, k in zip(recordings, known, strict=True)]
    times = [r.t_s[k] for r, k in zip(recordings, known, strict=True)]
    if not any(u.size > 2 and np.ptp(u) > 0 for u in drives):
        raise BadRecording(f"{recordings[0].name}: the drive does not move; nothing is covered")
    low, high = min(float(u.min()) for u in drives), max(float(u.max()) for u in drives)
    span = high - low
    rates = [_compute_rates(t, u) for t, u in zip(times, drives, strict=True)]
    moving = np.concatenate([np.abs(v[v != 0.0]) for v in map(sample, rates)])
    fastest = max(float(np.max(np.abs(v), initial=0.0)) for v in rates)
    rate_max = min(fastest, 1.5 * float(np.quantile(moving, 0.99))) if moving.size else fastest
    drive_edges = np.linspace(low, high, TUNING.drive_bins + 1)
    rate_edges = np.linspace(-rate_max, rate_max, TUNING.rate_bins + 1)
    cells = np.zeros((TUNING.drive_bins, TUNING.rate_bins))
    for u, v in zip(drives, rates, strict=True):
        _count(u, v, low, high, rate_max, cells)
    sizes = np.concatenate([_list_travels(u, 0.01 * span) for u in drives]) / span
    cycles = float(sizes.sum()) / 2.0
    rest_s = sum(
        float(np.sum(np.diff(t)[np.abs(v) < TUNING.still * rate_max]))
        for t, v in zip(times, rates, strict=True)
    )
    covered = float(np.mean(cells > 0))
    turning = sum(int(np.count_nonzero(v)) for v in rates)
    steps = span * turning / max(float(np.sum(sizes)) * span, 1e-300)
    missing, missing_rate = _find_missing(
        sizes, covered, cycles, steps, rate_max, recordings[0].drive_unit
    )
    return Coverage(
        cells,
        drive_edges,
        rate_edges,
        sizes,
        covered,
        cycles,
        rest_s,
        rate_max,
        missing,
        missing_rate,
    )


def _compute_rates(t: Floats, u: Floats) -> Floats:
    """Return (N - 1,) rates; those across gaps count as zero."""
    dt = np.diff(t)
    return np.where(dt <= 2.5 * typical_step(t), np.diff(u) / dt, 0.0)


def count_loop_sizes(u: Floats) -> NDArray[np.int64]:
    """Return the (4,) number of travels between turns of a drive (N,) in each class of loop
    sizes."""
    span = float(np.ptp(u))
    return _count_classes(_list_travels(u, 0.01 * span) / span)


def _count_classes(sizes: Floats) -> NDArray[np.int64]:
    return np.histogram(sizes, bins=np.array(SIZE_EDGES))[0]


def _find_missing(
    sizes: Floats, covered: float, cycles: float, steps: float, rate_max: float, unit: str
) -> tuple[tuple[str, ...], tuple[str, ...]]:
    static, rate = [], []
    if round(cycles, 1) < TUNING.fewest_cycles:
        static.append(
            f"the drive traverses its range only {cycles:.1f} times; "
            f"{TUNING.fewest_cycles:.0f} or more are needed, so that a part can be held out"
        )
    if steps < TUNING.steps_per_span:
        static.append(
            f"only {steps:.0f} samples per traverse of the range; sample faster or drive "
            "slower to resolve small loops"
        )
    found = _count_classes(sizes) > 0
    if int(found.sum()) < TUNING.enough_sizes:
        names = ["small (2 to 15 %)", "15 to 40 %", "40 to 70 %", "full (70 % and more)"]
        without = [name for name, has in zip(names, found, strict=True) if not has]
        static.append(
            f"loops of these sizes do not occur: {', '.join(without)}; "
            "superimpose a second sine of another frequency"
        )
    if covered < TUNING.enough_cells:
        rate.append(
            f"only {covered:.0%} of the drive-rate plane is covered "
            f"(up to {rate_max:.3g} {spell_unit(unit)}/s): "
            "drive and rate are correlated, as in a single sine or triangle, so rate-dependence "
            "cannot be distinguished from the shape of the loop"
        )
    return tuple(static), tuple(rate)
