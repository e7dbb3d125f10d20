"""dehyst simulate states an interval only for rows that have one."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from dehyst.daemon.files.models import save_model
from dehyst.daemon.files.recordings import write_recording
from dehyst.daemon.main import main
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
