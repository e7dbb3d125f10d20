"""dehyst simulate states an interval only for rows that have one."""

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from dehyst.daemon.files.models import save_model
from dehyst.daemon.files.recordings import write_recording
from dehyst.daemon.main import main
from dehyst.models.hysteresis.forward import simulate_hysteresis
from dehyst.models.model import Fit
from dehyst.models.modelfile import shipped


@pytest.mark.parametrize("times_rate", [0.5, 2.0])
def test_the_band_and_the_note_on_validity_agree(
    times_rate: float, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    model = shipped("paper-eq12")
    v = replace(model.validity, rate_max=100.0)
    save_model(replace(model, fit=Fit(band=0.011), validity=v), tmp_path / "model.toml")
    period = (v.drive_max - v.drive_min) * 2.0 / (times_rate * 100.0)
    t = np.arange(4000) * period / 1000.0
    u = v.drive_min + (v.drive_max - v.drive_min) * (1.0 - np.abs(2.0 * (t / period % 1.0) - 1.0))
    write_recording(tmp_path / "run.csv", t, {"u_v": u})
    given = ["simulate", str(tmp_path / "model.toml"), str(tmp_path / "run.csv")]
    assert main([*given, "-o", str(tmp_path / "out.csv")]) == 0
    said = capsys.readouterr().out
    all_outside = "100.0% of the rows are outside the model's validity: rate" in said
    assert all_outside == (times_rate > 1.0)
    assert ("+-0.011" in said) != all_outside
    assert ("no 95 % band" in said) == all_outside


def test_the_error_without_another_zero_of_the_gauge(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """The rms without the offset does not depend on the gauge's zero: it is what diagnosis.json
    gives."""
    model = shipped("paper-eq12")
    save_model(model, tmp_path / "model.toml")
    t = np.arange(3000) * 1e-3
    u = 3.5 - 3.5 * np.cos(2 * np.pi * 3 * t)
    y = simulate_hysteresis(model.hysteresis, u, 1e-3)
    y += 0.01 * np.random.default_rng(3).standard_normal(t.size)
    for zero in (0.0, 0.2):
        write_recording(tmp_path / "run.csv", t, {"u_v": u, "y_um": y + zero})
        given = ["simulate", str(tmp_path / "model.toml"), str(tmp_path / "run.csv"), "--force"]
        assert main([*given, "-o", str(tmp_path / "out.csv"), "--json"]) == 0
        said = json.loads(capsys.readouterr().out)
        assert said["rms"] == pytest.approx(np.hypot(0.01, zero), rel=0.05)
        assert said["offset"] == pytest.approx(zero, abs=0.002)
        assert said["rms_without_offset"] == pytest.approx(0.01, rel=0.05)
        assert said["rms_settled_without_offset"] == pytest.approx(0.01, rel=0.05)
        assert main([*given, "-o", str(tmp_path / "out.csv")]) == 0
        assert ("without its mean of 0.2" in capsys.readouterr().out) == bool(zero)
