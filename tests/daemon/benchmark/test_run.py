"""What the benchmark counts: held-out rows only, the rows needed, ties, and models that fail."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from dehyst.daemon.benchmark.cases import SIMULATED, Comparison, made_cases, read_cases
from dehyst.daemon.benchmark.report import lost, markdown
from dehyst.daemon.benchmark.rivals.interface import Predict, Rival, measured
from dehyst.daemon.benchmark.run import run_comparisons, run_one
from dehyst.daemon.files.recordings import write_recording
from dehyst.models.errors import BadInput, BadRecording
from dehyst.models.recording import Floats, Recording

N = 1000
T = np.arange(N) * 0.01


def case(made: bool = True) -> Comparison:
    """Return a straight line of 2 um/V; its last half is held out."""
    u = 5.0 - 5.0 * np.cos(T)
    whole = Recording(T, u, 2.0 * u, name="line")
    half = Recording(T[: N // 2], u[: N // 2], 2.0 * u[: N // 2], name="line")
    return Comparison("line", half, whole, np.arange(N) >= N // 2, made)


def gain(of: float) -> Predict:
    return lambda t_s, u: of * u


def rival(name: str, fit: object) -> Rival:
    assert callable(fit)
    return Rival(name, fit, "yes", "this test")


def test_the_error_is_that_of_the_held_out_rows_alone() -> None:
    def only_later(t_s: Floats, u: Floats) -> Floats:
        return 2.0 * u + np.where(np.arange(u.size) < N // 2, 100.0, 0.5)

    score = run_one(case(), rival("x", lambda recording: only_later))
    assert score.error == pytest.approx(0.5)
    span = np.ptp(case().held.displacement[N // 2 :])  # type: ignore[index]
    assert score.share == pytest.approx(100.0 * 0.5 / span)


def test_rows_needed_are_the_fewest_that_do() -> None:
    def fit(recording: Recording) -> Predict:
        return gain(2.1 if recording.size >= 120 else 3.0)

    assert run_one(case(), rival("x", fit)).rows == 125  # a quarter of 500
    assert run_one(case(made=False), rival("x", fit)).rows is None


def test_a_model_that_diverges_or_refuses_is_said_so() -> None:
    def refuse(recording: Recording) -> Predict:
        raise BadRecording("line: too little of the loop is shown")

    rivals = [
        rival("this project", lambda r: gain(2.2)),
        rival("best", lambda r: gain(2.1)),
        rival("wild", lambda r: lambda t_s, u: np.full(u.size, np.inf)),
        rival("shy", refuse),
    ]
    scores = run_comparisons([case()], rivals)
    assert scores[3].refused == "too little of the loop is shown"
    text = markdown(scores, rivals, ["other.csv: no displacement"])
    row = next(line for line in text.splitlines() if line.startswith("| line |"))
    assert "diverges" in row
    assert "no model" in row
    assert row.count("**") == 2
    assert "other.csv: no displacement" in text
    (one,) = lost(scores)
    assert one["case"] == "line"
    assert one["best"] == "best"


def test_a_tie_is_not_lost() -> None:
    rivals = [rival("this project", lambda r: gain(2.104)), rival("b", lambda r: gain(2.1))]
    scores = run_comparisons([case()], rivals)
    assert lost(scores) == []
    assert lost([replace(scores[0], share=scores[1].share * 1.06), scores[1]])


def test_the_first_part_of_a_recording_is_fitted(tmp_path: Path) -> None:
    whole = case().held
    write_recording(
        tmp_path / "a.csv", T, {"u_v": whole.drive, "y_um": np.asarray(whole.displacement)}, {}
    )
    (tmp_path / "b.csv").write_text("t_s,u_v\n0,1\n1,2\n")
    (one,), left_out = read_cases(tmp_path)
    assert one.name == "a.csv"
    assert one.fitted.size == 600
    assert one.held.size == 1000
    assert not one.scored[:600].any()
    assert one.scored[600:].all()
    assert len(left_out) == 1
    assert "b.csv" in left_out[0]


def test_a_folder_without_recordings_is_refused(tmp_path: Path) -> None:
    with pytest.raises(BadInput, match="contains no recording"):
        read_cases(tmp_path)


def test_the_made_stages_are_the_same_in_every_run() -> None:
    for one, again in zip(made_cases(), made_cases(), strict=True):
        for part in ("fitted", "held"):
            first, second = (measured(getattr(case, part)) for case in (one, again))
            np.testing.assert_array_equal(first, second, one.name)
        assert not np.array_equal(one.held.drive, one.fitted.drive[: one.held.size])


def test_every_hidden_effect_is_in_the_held_out_rows() -> None:
    held = {case.name: measured(case.held) for case in made_cases()}
    for name in SIMULATED.keys() - {"stack"}:
        left = held[name] - held["stack"]  # the noise is the same in both and cancels
        assert np.std(left) > 10.0 * SIMULATED[name].adc_step_um, name
