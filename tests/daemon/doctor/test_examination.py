"""What the doctor concludes from a case: a lag that is not in the model, a gauge that fails,
garbage."""

import json
import subprocess
from pathlib import Path

import numpy as np
import pytest
from tests.rigs.gateway_bench import wait_until
from tests.rigs.processes import dehyst, simulated_config
from tests.rigs.stage_model import kept_model

from dehyst.daemon.config import load_config
from dehyst.daemon.demo.second_act import pattern
from dehyst.daemon.doctor.examination import examine, try_models
from dehyst.daemon.doctor.next_step import excite_arguments
from dehyst.daemon.files import cases
from dehyst.daemon.files.cases import Case, Examined, OfferTest
from dehyst.daemon.files.models import load_model, save_model
from dehyst.daemon.files.recordings import read_recording, write_recording
from dehyst.daemon.main import main
from dehyst.drivers.simulated.settings import StageSettings
from dehyst.drivers.simulated.stage import SimulatedStage
from dehyst.models.change.lead import blank_lead
from dehyst.models.model import Block, Model
from dehyst.models.physics import with_blocks

RATE_HZ = 200.0
LAG_S = 0.015


def a_case(**more: object) -> Case:
    fields: dict = {
        "number": 5, "name": "mismatch-x", "time_ns": 1, "wall_ns": 1, "figure": "whole",
        "low": 0.0, "high": 150.0, "slew": 4000.0, "rate_hz": RATE_HZ, "later_s": 0.1,
    }  # fmt: skip
    return Case(**(fields | more))


def lay(folder: Path, stuck: bool = False, **change: float) -> Path:
    """Write a good, a flagged and a later recording of a stage that changes with the flag, each
    preceded by the history that led to it."""
    folder.mkdir(parents=True, exist_ok=True)
    t_s, volts = pattern(75.0, 66.0, RATE_HZ)
    seconds = t_s.size / RATE_HZ
    stage, drive, reading = SimulatedStage(StageSettings(seed=4)), [], []
    leads: dict[str, float] = {}
    for name in ("", cases.GOOD, cases.FLAGGED, cases.LATER):
        if name == cases.FLAGGED:
            stage.change(**change)
        _, measured = stage.run(t_s, volts)
        if name == cases.FLAGGED and stuck:
            measured = np.full(measured.size, 7.0)
        drive.append(np.r_[volts[0], volts[:-1]])
        reading.append(measured)
        if name:
            leads[name] = seconds * (len(drive) - 1)
            columns = {"u_v": np.concatenate(drive), "y_um": np.concatenate(reading)}
            times = np.arange(columns["u_v"].size) / RATE_HZ
            write_recording(folder / name, times, columns, {})
    save_model(kept_model(), folder / cases.IN_USE)
    cases.put_record(folder, cases.CASE, a_case(leads=leads))
    return folder


@pytest.mark.parametrize(
    ("change", "name", "place"),
    [
        ({"amplifier_tau_s": LAG_S}, "lag", "drive"),
        ({"creep_gain_per_decade": 0.045}, "creep", "stage"),  # needs the stage's history
        ({"friction_um": 0.3}, "friction", "stage"),  # the base model absorbs it entirely
    ],
)
def test_what_changed_is_named_and_the_model_with_it_is_offered(
    tmp_path: Path, change: dict[str, float], name: str, place: str
) -> None:
    found = examine(lay(tmp_path / "case", **change))
    assert name in (found.effects[0].name, *found.effects[0].ambiguous_with)
    assert found.rms_when_good < 0.5 * found.rms_in_use
    assert "It is new" in found.says
    assert found.tested is not None
    assert found.tested.offered < 0.5 * found.tested.in_use
    offered = load_model(tmp_path / "case" / cases.OFFERED)
    assert [b for b in offered.blocks if b.kind == name and b.place == place]
    assert b"<html" in (tmp_path / "case" / cases.REPORT).read_bytes().lower()
    assert json.loads((tmp_path / "case" / "found" / "diagnosis.json").read_text())["format"] == 2


def test_a_model_is_offered_and_tested_without_what_describes_one_recording(tmp_path: Path) -> None:
    """A controller does not run such blocks, so that a test with them says nothing of it."""
    folder = lay(tmp_path / "case", amplifier_tau_s=LAG_S)
    case = cases.get_record(folder, cases.CASE, Case)
    assert case is not None
    whole = read_recording(folder / cases.LATER, need_displacement=True)
    later = blank_lead(whole, case.leads[cases.LATER])
    lag = Block("lag", "drive", {"tau_s": LAG_S})
    creep = Block("earlier_creep", "stage", {"amount_um": -1.3, "since_s": 0.1})

    def tried(*blocks: Block) -> tuple[Model | None, OfferTest | None, str]:
        model = with_blocks(kept_model(), blocks)
        return try_models(case, kept_model(), [model], later, 0.02)

    offered, *rest = tried(lag, creep)
    assert offered is not None
    assert [b.kind for b in offered.blocks] == ["lag"]
    assert rest == list(tried(lag)[1:])
    nothing, _, why = tried(creep)
    assert nothing is None
    assert "creep of a move before the recording" in why


def test_a_gauge_that_fails_gets_no_model(tmp_path: Path) -> None:
    found = examine(lay(tmp_path / "case", stuck=True))
    assert found.verdict == "gauge"
    assert "stuck" in found.says
    assert found.tested is None
    assert found.experiment == ()
    assert not (tmp_path / "case" / cases.OFFERED).exists()


@pytest.mark.parametrize(
    ("pair", "slew"),
    [(None, 4000.0), (None, 60.0), (("delay", "lag"), 60.0), (("shape", "nothing"), 4000.0)],
)
def test_the_next_experiment_can_be_run_within_the_limits(
    tmp_path: Path, pair: tuple[str, str] | None, slew: float, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    arguments = excite_arguments(a_case(low=10.0, high=90.0, slew=slew), kept_model(), pair)
    assert main(list(arguments)) == 0
    drive = read_recording(tmp_path / "next.csv")
    assert drive.drive.min() >= 10.0 - 1e-6
    assert drive.drive.max() <= 90.0 + 1e-6
    rate = np.abs(np.diff(drive.drive)) / np.diff(drive.t_s)
    assert rate.max() <= slew * (1 + 1e-6)


def test_the_process_examines_each_case_once_alone_and_ends_when_asked(tmp_path: Path) -> None:
    save_model(kept_model(), tmp_path / "model.toml")
    path = simulated_config(tmp_path, 200.0, tmp_path / "model.toml")
    (tmp_path / "run").mkdir(mode=0o700)
    folder = load_config(path).watch_directory / "mismatch-garbage.case"
    folder.mkdir(parents=True)
    for name in (cases.FLAGGED, cases.IN_USE):
        (folder / name).write_text("nothing of this kind\n")
    cases.put_record(folder, cases.CASE, a_case())
    quiet = {"stdout": subprocess.DEVNULL, "stderr": subprocess.DEVNULL}
    doctor = dehyst("doctor", "--config", str(path), **quiet)
    try:
        wait_until("it is examined", lambda: (folder / cases.EXAMINED).exists())
        found = cases.get_record(folder, cases.EXAMINED, Examined)
        assert found is not None
        assert found.failed
        assert "could not be diagnosed" in found.says
        second = dehyst("doctor", "--config", str(path))
        _, says = second.communicate(timeout=60)
        assert second.returncode == 2
        assert "is in use by process" in says
    finally:
        doctor.terminate()
        assert doctor.wait(30.0) == 0
