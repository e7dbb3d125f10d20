"""Exclusion limits: how small an effect these recordings would have shown, for each candidate.

The limit is the strength whose contribution, with everything else refitted, reaches the size at
which the search accepts. What stays below it at every sensible strength cannot be seen in these
recordings at all, and the limit says so.
"""

import numpy as np

from dehyst.models.diagnosis.effects import Effect
from dehyst.models.diagnosis.judge import SearchState, excess, least_size
from dehyst.models.diagnosis.result import Limit
from dehyst.models.diagnosis.screen import Screen
from dehyst.models.diagnosis.tuning import TUNING
from dehyst.models.physics import library
from dehyst.models.physics.candidate import Candidate

CANNOT = "the drive of these recordings cannot show it"


def limits(found: SearchState) -> list[Limit]:
    """One limit for each name in the library that was not found, the tightest of its kinds."""
    problem, sigma = found.problem, found.sigma
    look = Screen(problem, found.accepted)
    named = {e.candidate.name for e in found.accepted.effects}
    left = excess(problem, found.accepted, sigma)
    out: dict[tuple[str, str], Limit] = {}
    for c in library(problem.data):
        if c.name in named:
            continue
        least = (least_size(c) * sigma) ** 2
        if c.driven:
            least = max(least, TUNING.driven_share * left)
        limit = _limit(look, c, float(np.sqrt(least)))
        if limit is None:
            continue
        key = (c.name, c.channel)
        if key not in out or _tighter(limit, out[key]):
            out[key] = limit
    return list(out.values())


def _tighter(a: Limit, b: Limit) -> bool:
    if a.value is None or b.value is None:
        return b.value is None
    return a.value < b.value if a.side == "above" else a.value > b.value


def _limit(look: Screen, c: Candidate, least: float) -> Limit | None:
    probes = c.probes(look.problem.data)
    if not probes:
        return None
    label = f"{c.name} ({c.channel})" if c.channel else c.name
    sizes = []
    for probe in probes:
        x = look.contribution(Effect(c, probe.theta))
        if c.mode == "columns":
            x = x @ np.array(probe.amplitudes)[:, None]
        size = float(np.sqrt(np.mean(look.projected(x) ** 2)))
        sizes.append(size)
        if size > 3 * least:
            break
    if c.mode == "columns":  # linear in the amplitude
        if sizes[0] < 1e-12:
            return Limit(c.name, None, c.limit_unit, c.limit_side, f"{label}: {CANNOT}")
        return Limit(c.name, least / sizes[0] * probes[0].value, c.limit_unit, c.limit_side, label)
    reached = [k for k, size in enumerate(sizes) if size >= least]
    if not reached:
        return Limit(c.name, None, c.limit_unit, c.limit_side, CANNOT)
    k = reached[0]
    value = probes[k].value
    if k > 0 and sizes[k - 1] > 0:
        part = np.log(least / sizes[k - 1]) / np.log(sizes[k] / sizes[k - 1])
        value = probes[k - 1].value * (value / probes[k - 1].value) ** float(np.clip(part, 0, 1))
    return Limit(c.name, float(value), c.limit_unit, c.limit_side)
