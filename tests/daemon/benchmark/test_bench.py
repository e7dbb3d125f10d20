"""`dehyst bench`: one case end to end; two runs give the same result."""

import json
import sys
from pathlib import Path

import pytest

from dehyst.daemon.main import main

ONE = ["bench", "--only", "Eq. 12", "--json"]


def test_two_runs_give_the_same_figures_but_for_the_cost(
    tmp_path: Path, capsys: pytest.CaptureFixture
) -> None:
    assert main([*ONE, "-o", str(tmp_path / "out")]) == 0
    first = json.loads(capsys.readouterr().out)
    assert main(ONE) == 0
    again = json.loads(capsys.readouterr().out)
    assert first.pop("cost_ratio").keys() == again.pop("cost_ratio").keys()
    assert first == again
    by_model = {one["model"]: one for one in first["scores"]}
    assert len(by_model) == 7
    own = by_model["this project"]["error_percent"]  # the stage is of its class, with 20 nm noise
    assert own < 0.25
    assert all(own <= one["error_percent"] for one in by_model.values())
    table = (tmp_path / "out" / "bench.md").read_text()
    assert "| Eq. 12 | **" in table


def test_without_scikit_learn_the_other_models_are_compared(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture
) -> None:
    for name in ("sklearn", "sklearn.exceptions", "sklearn.neural_network"):
        monkeypatch.setitem(sys.modules, name, None)  # as if not installed
    assert main([*ONE]) == 0
    scores = json.loads(capsys.readouterr().out)["scores"]
    refused = {one["model"]: one["refused"] for one in scores if one["refused"]}
    assert list(refused) == ["neural net"]
    assert "dehyst[bench]" in refused["neural net"]


def test_a_case_that_is_not_there_is_refused(capsys: pytest.CaptureFixture) -> None:
    assert main(["bench", "--only", "moon"]) == 2
    assert "there is no case 'moon'" in capsys.readouterr().err
