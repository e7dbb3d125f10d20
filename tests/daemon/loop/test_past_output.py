"""The output at a start: what the unit reports, and what was written last."""

from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from dehyst.daemon.config import Config, parse_config
from dehyst.daemon.loop.checks import LEFT, note_output, past_output
from dehyst.daemon.rings.records import TELEMETRY
from dehyst.daemon.rings.ring import Ring
from dehyst.drivers.nidaqmx import NidaqmxActuator
from dehyst.drivers.python_object import PythonActuator
from dehyst.drivers.simulated.devices import SimulatedActuator

TEXT = """
name = "past"
run_dir = "{}"
model = {{file = "none"}}
actuator = {{driver = "simulated"}}
sensor = {{driver = "simulated"}}
limits = {{min_v = 0.0, max_v = 100.0, slew_v_per_s = 4000.0}}
"""


def records(*volts: float) -> Any:
    made = np.zeros(len(volts), TELEMETRY)
    made["volts"] = volts
    return made


@pytest.fixture
def config(tmp_path: Path) -> Config:
    """A controller whose last core left the output at 60 V."""
    made = parse_config(TEXT.format(tmp_path))
    made.directory.mkdir(parents=True, exist_ok=True)
    ring = Ring.create(made.directory / "telemetry.ring", TELEMETRY, 64)
    ring.push_many(records(40.0, 50.0, 60.0))
    return made


def actuator(known: bool) -> Any:
    return SimpleNamespace(spec=SimpleNamespace(output_known=known))


@pytest.mark.parametrize(
    ("known", "reported_v", "stands_v"),
    [(True, 60.3, 60.0), (True, 0.0, 0.0), (False, 0.0, 60.0), (False, 60.0, 60.0)],
)
def test_a_report_counts_only_where_the_hardware_was_asked(
    config: Config, known: bool, reported_v: float, stands_v: float
) -> None:
    past, said = past_output(config, reported_v, actuator(known))
    assert (past[-1], said) == (stands_v, [])


def test_a_range_that_was_made_smaller_ends_the_trust_in_what_was_written(config: Config) -> None:
    smaller = parse_config(TEXT.format(config.run_dir).replace("100.0", "55.0"))
    past, _ = past_output(smaller, 0.0, actuator(False))
    assert past.tolist() == [0.0]


def test_a_noted_output_is_the_newest_until_the_loop_writes_again(config: Config) -> None:
    ring = Ring.attach(config.directory / "telemetry.ring", TELEMETRY)
    note_output(config, 12.5)
    assert past_output(config, 0.0, actuator(False))[0].tolist() == [40.0, 50.0, 60.0, 12.5]
    ring.push_many(records(13.0, 14.0))
    assert past_output(config, 0.0, actuator(False))[0].tolist() == [40.0, 50.0, 60.0, 13.0, 14.0]


def test_a_noted_output_needs_no_ring_and_yields_to_the_next_run(config: Config) -> None:
    path = config.directory / "telemetry.ring"
    note_output(config, 12.5)
    path.unlink()
    assert past_output(config, 0.0, actuator(False))[0].tolist() == [12.5]
    ring = Ring.create(path, TELEMETRY, 64, run=7)
    assert past_output(config, 0.0, actuator(False))[0].tolist() == [12.5]
    ring.push_many(records(1.0, 2.0, 3.0))  # as many as when the note was made
    assert past_output(config, 0.0, actuator(False))[0].tolist() == [1.0, 2.0, 3.0]


def test_a_noted_output_does_not_overrule_the_hardware(config: Config) -> None:
    note_output(config, 12.5)
    assert past_output(config, 30.0, actuator(True))[0].tolist() == [30.0]


@pytest.mark.parametrize("text", ["", "1 3", "1 3 nan", "1 x 5.0", "9" * 300])
def test_a_damaged_note_is_ignored(config: Config, text: str) -> None:
    (config.directory / LEFT).write_text(text)
    assert past_output(config, 0.0, actuator(False))[0].tolist() == [40.0, 50.0, 60.0]


def test_a_note_that_cannot_be_written_stops_nothing(config: Config) -> None:
    (config.directory / LEFT).mkdir()
    note_output(config, 12.5)
    assert past_output(config, 0.0, actuator(False))[0].tolist() == [40.0, 50.0, 60.0]


def test_which_drivers_can_be_asked() -> None:
    ni = NidaqmxActuator.from_settings({"channel": "Dev1/ao0"})
    given = {"object": "a:b", "write": "w", "max_v": 9.0}
    blind = PythonActuator.from_settings({**given, "initial_v": 0.0, "max_rate_hz": 100.0})
    asked = PythonActuator.from_settings({**given, "output": "o"})
    simulated = SimulatedActuator.from_settings({"stage": "asked"})
    known = [device.spec.output_known for device in (ni, blind, asked, simulated)]
    assert known == [False, False, True, True]
