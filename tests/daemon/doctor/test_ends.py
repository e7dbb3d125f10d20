"""How an examination ends, and that its end is reported as it happened."""

import os
import signal
import time
from pathlib import Path

import numpy as np
import pytest
from tests.daemon.doctor.test_examination import RATE_HZ, a_case
from tests.rigs.stage_model import kept_model

from dehyst.daemon.doctor.child import examine_or_explain
from dehyst.daemon.doctor.examination import examine
from dehyst.daemon.doctor.process import describe_exit, processor_s, why_to_stop
from dehyst.daemon.files import cases
from dehyst.daemon.files.cases import Examined
from dehyst.daemon.files.models import save_model
from dehyst.daemon.files.recordings import write_recording
from dehyst.drivers.simulated.settings import StageSettings
from dehyst.drivers.simulated.stage import SimulatedStage
from dehyst.models import diagnosis
from dehyst.models.errors import BadRecording

LEAD_S, STEPS = 25.0, (0.0, 0.2, 0.0, 0.4, 0.0, 1.0)


def at_rest(folder: Path, step_um: float) -> Path:
    """Write the case of a stage that moves to its position and stands still, while its gauge steps
    up and back, in the end by step_um."""
    folder.mkdir()
    t_s = np.arange(round(35 * RATE_HZ)) / RATE_HZ
    volts = 75.0 + 2.7 * np.minimum(t_s / 12.0, 1.0)
    steps = step_um * np.repeat(STEPS, -(-t_s.size // len(STEPS)))[: t_s.size]
    for name in (cases.GOOD, cases.FLAGGED, cases.LATER):
        _, measured = SimulatedStage(StageSettings(seed=4)).run(t_s, volts)
        measured = measured + (steps if name != cases.GOOD else 0.0)
        write_recording(folder / name, t_s, {"u_v": volts, "y_um": measured}, {})
    save_model(kept_model(), folder / cases.IN_USE)
    leads = {cases.GOOD: 0.0, cases.FLAGGED: LEAD_S, cases.LATER: LEAD_S}
    cases.put_record(folder, cases.CASE, a_case(figure="fit", leads=leads))
    return folder


@pytest.mark.parametrize("step_um", [3.0, 0.3])
def test_a_stage_at_rest_is_examined_and_all_pictures_of_its_report_are_drawn(
    tmp_path: Path, step_um: float
) -> None:
    folder = at_rest(tmp_path / "rest.case", step_um)
    found = examine(folder)
    assert not found.failed
    assert found.says
    if (folder / cases.REPORT).exists():
        assert "could not be drawn" not in (folder / cases.REPORT).read_text()


def test_findings_are_kept_where_the_report_cannot_be_made(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def fails(*_: object) -> str:
        raise ValueError("no room for the loop")

    monkeypatch.setattr("dehyst.daemon.report.diagnosis.report_diagnosis", fails)
    monkeypatch.setattr("dehyst.daemon.doctor.examination.find_moved_zero", lambda *_: "")
    found = examine(at_rest(tmp_path / "rest.case", 3.0))
    assert not found.failed
    assert found.effects
    assert "The report could not be written (no room for the loop)." in found.says


@pytest.mark.parametrize(
    ("error", "says"),
    [
        (BadRecording("no rows"), "The recording could not be diagnosed: no rows"),
        (MemoryError(), "it takes more than 4 GB"),
        (ValueError("no positive values"), "error in dehyst, not in the stage: ValueError: no"),
        (AssertionError(), "error in dehyst, not in the stage: AssertionError"),
    ],
)
def test_what_ended_an_examination_is_said_as_it_was(
    tmp_path: Path, error: Exception, says: str
) -> None:
    def fails(_place: Path) -> Examined:
        raise error

    found = examine_or_explain(tmp_path, 4.0, fails)
    assert found.failed
    assert says in found.says
    assert ("GB" in found.says) == isinstance(error, MemoryError)


@pytest.mark.parametrize(
    ("code", "says"),
    [(1, "exit code 1"), (-signal.SIGSEGV, "by SIGSEGV"), (-signal.SIGKILL, "from outside")],
)
def test_a_process_that_leaves_no_result_is_said_to_have_ended_as_it_did(
    code: int, says: str
) -> None:
    assert says in describe_exit(code)
    assert "GB" not in describe_exit(code)


def test_a_diagnosis_of_a_stage_at_rest_has_all_pictures(tmp_path: Path) -> None:
    from dehyst.daemon.files.recordings import read_recording
    from dehyst.daemon.report.diagnosis import report_diagnosis

    flagged = read_recording(at_rest(tmp_path / "rest.case", 3.0) / cases.FLAGGED)
    found = diagnosis.diagnose([flagged], kept_model(), with_limits=False)
    page = report_diagnosis(found, [flagged.name])
    assert page.count("<img") == 11
    assert "could not be drawn" not in page


def test_an_examination_that_other_work_keeps_waiting_is_not_ended_as_a_slow_one() -> None:
    assert why_to_stop(900.0, 800.0, 700.0) == ""
    assert why_to_stop(900.0, 4000.0, 30.0) == ""
    assert "901 s of processor time" in why_to_stop(900.0, 902.0, 901.0)
    starved = why_to_stop(900.0, 6000.0, 30.0)
    assert "left it only 30 s of processor time in 6000 s" in starved


def test_the_time_on_a_processor_is_that_of_the_process() -> None:
    before_s = time.process_time()
    while time.process_time() - before_s < 0.1:
        pass
    assert processor_s(os.getpid()) >= before_s + 0.05
    assert processor_s(0) == 0.0
