"""A start that ends before the first sample does not forget where an output stands."""

from pathlib import Path

import numpy as np
from tests.rigs.processes import simulated_config
from tests.rigs.stage_model import kept_model

from dehyst.daemon.config import Config, load_controller
from dehyst.daemon.files.models import save_model
from dehyst.daemon.loop.axes.core import AxisCore
from dehyst.daemon.rings.records import TELEMETRY
from dehyst.daemon.rings.ring import Ring


class Blind:
    """An amplifier that cannot report its output."""

    def write(self, volts: float) -> None:
        """Set the output."""


def configured(folder: Path) -> Config:
    """Return the configuration of a blind amplifier."""
    save_model(kept_model(), folder / "model.toml")
    path = simulated_config(folder, 200.0, folder / "model.toml")
    settings = f'object = "{__name__}:Blind", write = "write", max_v = 150.0, initial_v = 0.0'
    text = path.read_text()
    driver, stage = '"simulated"', '{stage = "t"}'
    text = text.replace(driver, '"python"', 1)
    path.write_text(text.replace(stage, f"{{{settings}, max_rate_hz = 500.0}}", 1))
    (config,) = load_controller(path).axes
    assert config.actuator.driver == "python"
    assert config.sensor.driver == "simulated"
    return config


def start_and_end(config: Config) -> float:
    """Make the rings and end without a sample; return the output that the start believes in."""
    axis = AxisCore(config, lambda status: None)
    axis.open()
    try:
        axis.begin()
        axis.prepare({config.axis: axis}, 1, 1, 0)
        return axis.stepper.volts
    finally:
        axis.close()


def test_starts_that_end_before_their_first_sample_forget_no_output(tmp_path: Path) -> None:
    config = configured(tmp_path)
    config.directory.mkdir()
    ring = Ring.create(config.directory / "telemetry.ring", TELEMETRY, 64, run=5)
    records = np.zeros(3, TELEMETRY)
    records["volts"] = (40.0, 50.0, 60.0)
    ring.push_many(records)
    assert [start_and_end(config) for _ in range(3)] == [60.0, 60.0, 60.0]
