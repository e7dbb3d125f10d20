"""Recordings of one stage, each of which begins with another history of the stage."""

from dataclasses import replace

import numpy as np
import pytest
from tests.rigs.diagnosis import diagnose_without_limits

from dehyst.models.cascade.history import replay
from dehyst.models.diagnosis.base import rich_base
from dehyst.models.diagnosis.data.prepare import prepare
from dehyst.models.diagnosis.diagnosed_model import take_given_model
from dehyst.models.diagnosis.fit import Problem
from dehyst.models.diagnosis.pasts import choose_pasts, explained_heads
from dehyst.models.diagnosis.search_problem import choose_model_under_base
from dehyst.models.model import Block, Hysteresis, Model, Validity
from dehyst.models.recording import Recording
from dehyst.models.signals.pasts import FRESH, FROM_ABOVE, FROM_BELOW

DT, NOISE = 2e-3, 0.01
R = np.array([0.0, 1.0, 2.0, 3.0, 4.0, 4.7])
B = np.array([0.8, 0.05, 0.05, 0.05, 0.05, 0.05])
BEFORE = {FRESH: [0.0], FROM_ABOVE: [0.0, 10.0], FROM_BELOW: [0.0, 10.0, 0.0]}


def stage(u: np.ndarray, b: np.ndarray = B) -> np.ndarray:
    """Run the play operators one by one, from 0."""
    h, out = np.zeros(R.size), np.empty(u.size)
    for k, v in enumerate(u):
        h = np.maximum(v - R, np.minimum(v + R, h))
        out[k] = b @ h
    return out


def record(u: np.ndarray, past: int, seed: int, name: str) -> Recording:
    y = stage(np.append(BEFORE[past], u))[len(BEFORE[past]) :]
    noise = NOISE * np.random.default_rng(seed).standard_normal(u.size)
    return Recording(DT * np.arange(u.size), u, y + noise, name=name)


def recordings(past: int) -> list[Recording]:
    t = DT * np.arange(4000)
    run = 5.0 - 3.4 * np.cos(2 * np.pi * 0.5 * t) - 1.6 * np.cos(2 * np.pi * 2.3 * t)
    inner = 5.0 + 1.6 * np.sin(2 * np.pi * 1.1 * t) + 1.2 * np.sin(2 * np.pi * 3.7 * t)
    return [record(run, FRESH, 0, "run"), record(inner, past, 1, "inner")]


@pytest.mark.parametrize("past", BEFORE)
def test_the_past_of_a_recording_is_found(past: int) -> None:
    data = choose_pasts(prepare(recordings(past)))
    assert data.forgets[data.forgets > 0].tolist() == [FRESH, past]


def test_a_head_counts_where_its_past_explains_it_and_not_behind_a_wrong_one() -> None:
    data = choose_pasts(prepare(recordings(FROM_BELOW)))
    assert np.any(data.heads & (data.rec == 1))
    problem = Problem(data, rich_base(data))
    assert explained_heads(problem, problem.solve([]), NOISE) == [1]
    head = np.where(data.heads, 10.0 * NOISE, 0.0)
    moved = Problem(replace(data, y=data.y + np.cumsum(head) / 20.0), problem.base)
    assert explained_heads(moved, moved.solve([]), NOISE) == []


def test_a_past_is_no_shape_and_the_errors_are_those_of_the_written_models() -> None:
    """The stage is of the model's own class, and contains no other effect."""
    given = recordings(FROM_BELOW)
    found = diagnose_without_limits(given)
    assert found.verdict == "clean"
    for one, view in zip(given, found.views, strict=True):
        assert one.displacement is not None
        for key, model in (("model", found.base_model), ("augmented", found.model)):
            y = replay(model, one.t_s, one.drive, one.channels, one.displacement).predicted
            error = float(np.std((one.displacement - y)[view.counted]))
            assert found.rms[key][one.name] == pytest.approx(error, rel=1e-6)
            assert error < 1.3 * NOISE


def test_a_given_model_that_begins_elsewhere_is_no_ground_to_stand_on() -> None:
    """Loops that grow from rest. The right model predicts where each loop begins; a model with the
    same plays that begins in the middle of the range predicts it wrongly, and no shape corrects
    that."""
    t, b = DT * np.arange(4000), np.array([0.5, 0.1, 0.1, 0.1, 0.1, 0.1])
    waves = sum(np.sin(2 * np.pi * f * t + k) for k, f in enumerate((0.21, 1.7, 4.1)))
    grows = np.linspace(0.5, 1.0, t.size) * waves / np.abs(waves).max()
    u = 5.0 * np.clip(t / 0.2, 0.0, 1.0) * (1.0 + grows)
    y = stage(u, b) + 0.1 * NOISE * np.random.default_rng(0).standard_normal(u.size)
    data = prepare([Recording(t, u, y, name="growing")])
    right = Model(Hysteresis(r=R, b=b, c=np.array([0.0, 1.0])), Validity(0.0, 10.0))
    middle = replace(right, hysteresis=replace(right.hysteresis, u_offset=5.0))
    delayed = replace(middle, blocks=(Block("delay", "drive", {"delay_s": 0.01}),))
    stands = {}
    for name, model in (("right", right), ("middle", middle), ("with a block", delayed)):
        problem = Problem(data, rich_base(data), take_given_model(model, data))
        stands[name] = choose_model_under_base(problem, problem.solve([])).diagnosed.carries
    assert stands == {"right": True, "middle": False, "with a block": True}


def test_only_what_begins_at_the_lowest_drive_of_all_recordings_may_count_from_its_start() -> None:
    t = np.arange(4000) * 1e-3
    from_rest = 5 - 5 * np.cos(2 * np.pi * t)
    from_a_level = 6.5 - 3.5 * np.cos(2 * np.pi * t)  # its own lowest drive, not the stage's
    noise = 0.01 * np.random.default_rng(3).standard_normal((2, t.size))
    both = [
        Recording(t, u, 0.1 * u + e, name=name)
        for u, e, name in zip((from_rest, from_a_level), noise, "ab", strict=True)
    ]
    data = prepare(both)
    assert data.rows[data.rec == 0].all()
    assert not data.rows[np.flatnonzero(data.rec == 1)[:200]].any()
    alone = prepare(both[1:])
    assert alone.rows.all()
