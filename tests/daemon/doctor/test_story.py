"""Watch and doctor on telemetry of the simulated stage, faster than real time: minutes without a
fault, and gauges that fail.

Stage, controller, watch and examination are the real ones; time is a count of samples. For an hour
without a fault: tests/benchmarks/daemon/second_act_offline.py --clean 3600.
"""

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path

import numpy as np
import pytest
from tests.rigs.stage_model import kept_model
from tests.rigs.story import OfflineStory

from dehyst.models.model import Model

Reading = Callable[[float, float], float]
"""(seconds since the failure began, true reading) -> the gauge's reading."""
RNG = np.random.default_rng(8)


@pytest.fixture(scope="module")
def model() -> Model:
    return kept_model()


@contextmanager
def learned(folder: Path, model: Model) -> Iterator[OfflineStory]:
    with OfflineStory(folder, model, 5) as story:
        assert story.until(story.learned, 240.0)
        story.wait(3.0)
        yield story


def test_a_stage_in_order_raises_no_flag(tmp_path: Path, model: Model) -> None:
    with learned(tmp_path / "order", model) as story:
        story.wait(600.0)
        assert story.events == []
        assert story.open_case() is None


@pytest.mark.parametrize(
    ("says", "gauge"),
    [
        ("stuck", lambda _s, _y: 7.0),
        ("no valid reading", lambda _s, _y: float("nan")),
        ("no valid reading", lambda s, y: y if s % 1.0 < 0.6 else float("nan")),
        ("far outside", lambda s, y: y if s % 4.0 < 3.0 else 70.0 + 0.01 * y),
        ("noisier", lambda _s, y: y + RNG.normal(0.0, 0.2)),
        ("zero drifts", lambda s, y: y + 0.03 * s),
        ("zero has moved", lambda _s, y: y - 1.0),
    ],
    ids=["stuck", "silent", "gaps", "far", "noise", "drift", "offset"],
)
def test_for_a_gauge_that_fails_no_model_is_offered_and_it_is_said(
    tmp_path: Path, model: Model, says: str, gauge: Reading
) -> None:
    with learned(tmp_path / "gauge", model) as story:
        began_s = story.now_s
        story.tamper = lambda _rig, reading: gauge(story.now_s - began_s, reading)
        assert story.until(lambda: story.watch.mismatch, 30.0)
        assert story.until(lambda: story.open_case() is not None, 60.0)
        folder = story.open_case()
        assert folder is not None
        found = story.examine(folder)
        assert found.verdict == "gauge"
        assert says in found.says
        assert found.tested is None
        assert not (folder / "offered.toml").exists()
