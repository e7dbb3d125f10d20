"""A model run on a recording that may begin anywhere in a stage's life.

What the stage went through before the first row is not in the file. Three histories are tried:
de-energised, come from the top of the model's drive range, and come from its bottom after the top.
Each is driven slowly before the first row, so that every block with a memory has been through it.
"""

from collections.abc import Mapping
from typing import NamedTuple

import numpy as np

from dehyst.models.cascade.simulate import simulate
from dehyst.models.model import Floats, Model

DE_ENERGISED = "de-energised"
LEG_SAMPLES, LEG_S = 200, 20.0
"""Of one way over the range: slow, so that nothing but memory is left of it."""
BETTER = 0.01
"""Of the error: what a history must take away before it is believed in place of the ones before."""


class Replay(NamedTuple):
    """start: the history that fits; predicted: (N,) the reading by the model behind it."""

    start: str
    predicted: Floats


def replay(
    model: Model, t_s: Floats, u: Floats, channels: Mapping[str, Floats], y: Floats
) -> Replay:
    """The model on the drive u (N,) behind the history that fits the reading y (N,) best, its mean
    left out; NaN in y count for nothing. Raises BadInput as `simulate` does."""
    best, least = Replay(DE_ENERGISED, simulate(model, t_s, u, channels)), np.inf
    for start, legs in {DE_ENERGISED: [], **_list_legs(model, float(u[0]))}.items():
        predicted = best.predicted if not legs else _simulate_led(model, t_s, u, channels, legs)
        left = _spread(y - predicted)
        if left < (1.0 - BETTER) * least:
            best, least = Replay(start, predicted), left
    return best


def _spread(error: Floats) -> float:
    return float(np.nanstd(error)) if np.any(np.isfinite(error)) else 0.0


def _list_legs(model: Model, first: float) -> dict[str, list[float]]:
    """Turning points before the first row, by the stage's history."""
    v = model.validity
    rest = min(max(0.0, v.drive_min), v.drive_max)
    return {
        "from above": [rest, v.drive_max, first],
        "from below": [rest, v.drive_max, v.drive_min, first],
    }


def _simulate_led(
    model: Model, t_s: Floats, u: Floats, channels: Mapping[str, Floats], legs: list[float]
) -> Floats:
    """`simulate` behind the ways between these drives."""
    way = np.interp(
        np.arange(LEG_SAMPLES * (len(legs) - 1)) / LEG_SAMPLES, np.arange(len(legs)), legs
    )
    before = t_s[0] - (LEG_S / LEG_SAMPLES) * np.arange(way.size, 0, -1)
    led = {name: np.append(np.full(way.size, c[0]), c) for name, c in channels.items()}
    return simulate(model, np.append(before, t_s), np.append(way, u), led)[way.size :]
