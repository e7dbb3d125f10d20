"""The model that an axis runs: it and its reach belong together in every status, and nothing of one
recording is in it."""

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
from dehyst.models.model import Block
from dehyst.models.modelfile import dumps
from dehyst.models.physics import with_blocks


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


def test_what_describes_one_recording_is_not_run_and_it_is_said(tmp_path: Path) -> None:
    """Creep of a move before a recording would predict a stage that moves at every start."""
    plain = kept_model()
    creep = Block("earlier_creep", "stage", {"amount_um": -1.3, "since_s": 0.1})
    lag = Block("lag", "stage", {"tau_s": 0.004})

    save_model(with_blocks(plain, [creep, lag]), tmp_path / "model.toml")
    (config,) = load_controller(simulated_config(tmp_path, 200.0, tmp_path / "model.toml")).axes
    axis = core.AxisCore(config, lambda status: None)
    axis.open()
    try:
        axis.begin()
        axis.prepare({config.axis: axis}, 1, 1, 0)
        axis.say_how("for this test")
        said = "creep of a move before the recording"
        assert [e for e in axis.stepper.events if said in e]
        assert [b.kind for b in axis.model.blocks] == ["lag"]
        axis.stepper.events.clear()
        axis.reload()
        assert [e for e in axis.stepper.events if said in e]
        assert [b.kind for b in axis.model.blocks] == ["lag"]
    finally:
        axis.close()
