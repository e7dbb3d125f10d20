"""The model and the reach in a status belong together, whenever the status is filled."""

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from tests.rigs.processes import simulated_config
from tests.rigs.stage_model import kept_model

from dehyst.daemon.config import load_controller
from dehyst.daemon.config.drives import drive_range
from dehyst.daemon.files.models import save_model
from dehyst.daemon.loop.axes import core
from dehyst.daemon.rings.records import model_digest
from dehyst.daemon.rings.status import STATUS
from dehyst.models.cascade.reach import displacement_range
from dehyst.models.modelfile import dumps


def test_each_status_during_a_reload_is_of_one_model(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    small = kept_model()
    big = replace(small, hysteresis=replace(small.hysteresis, c=1.5 * small.hysteresis.c))
    save_model(small, tmp_path / "model.toml")
    (config,) = load_controller(simulated_config(tmp_path, 200.0, tmp_path / "model.toml")).axes
    axis = core.AxisCore(config, lambda status: None)
    seen: list[tuple[str, float]] = []

    def fill(*_: Any) -> None:
        """Fill a status now."""
        status = np.zeros(1, STATUS)
        axis._fill_model(status, 0.0)
        width = float(status["reach_max"][0] - status["reach_min"][0])
        seen.append((status["model"][0].decode(), width))

    def write(path: Path, text: str) -> None:
        path.write_text(text)
        fill()

    class Reaching(core.AxisCore):
        def __setattr__(self, name: str, value: object) -> None:
            super().__setattr__(name, value)
            fill()

    axis.open()
    try:
        axis.begin()
        axis.prepare({config.axis: axis}, 1, 1, 0)
        save_model(big, tmp_path / "model.toml")
        monkeypatch.setattr(core, "write_text", write)
        axis.__class__ = Reaching  # after each step of the reload that another thread could see
        axis.reload()
        fill()
    finally:
        axis.close()
    widths = {}
    for model in (small, big):
        low, high = displacement_range(model, *drive_range(config, model))
        widths[model_digest(dumps(model))] = high - low
    assert {digest for digest, _ in seen} == widths.keys()
    assert all(width == pytest.approx(widths[digest]) for digest, width in seen)
