"""A recording may begin anywhere in a stage's life; its history is estimated from the data."""

from dataclasses import replace

import numpy as np
import pytest

from dehyst.models.cascade.history import replay
from dehyst.models.cascade.simulate import simulate
from dehyst.models.model import Block, Model
from dehyst.models.modelfile import shipped

T, NOISE = 1e-3, 0.02
LEGS = {"de-energised": [], "from above": [10.0], "from below": [10.0, 0.0]}


def stage(*blocks: Block) -> Model:
    return replace(shipped("paper-eq11"), blocks=blocks)


def begin_late(model: Model, before: list[float], zero: float) -> tuple[np.ndarray, ...]:
    """Return a recording (t_s, u, y) of a stage that was moved slowly to some drives before, read
    by a sensor that was zeroed again."""
    corners = [0.0, *before, 4.0]
    way = np.interp(np.linspace(0.0, 1.0, 4000), np.linspace(0.0, 1.0, len(corners)), corners)
    u = 4.0 + 1.5 * np.sin(2 * np.pi * 2 * T * np.arange(1500))
    y = simulate(model, T, np.concatenate([way, u]))[4000:]
    noise = NOISE * np.random.default_rng(1).normal(size=u.size)
    return T * np.arange(u.size), u, y + noise + zero


@pytest.mark.parametrize("start", LEGS)
@pytest.mark.parametrize("block", [None, Block("lag", "drive", {"tau_s": 0.004})])
def test_the_history_is_found_and_predicts(start: str, block: Block | None) -> None:
    model = stage(*([block] if block else []))
    t_s, u, y = begin_late(model, LEGS[start], zero=3.0)
    found = replay(model, t_s, u, {}, y)
    assert found.start == start
    assert np.std((y - found.predicted)[50:]) < 1.1 * NOISE


def test_de_energised_is_believed_where_nothing_tells() -> None:
    model = stage()
    t_s, u, y = begin_late(model, [], zero=0.0)
    assert replay(model, t_s, u, {}, np.full(u.size, np.nan)).start == "de-energised"
    few = np.where(np.arange(u.size) % 7 == 0, y, np.nan)
    assert replay(model, t_s, u, {}, few).start == "de-energised"
