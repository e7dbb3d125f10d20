"""Check a trajectory of several axes, in this process."""

from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from tests.rigs.stage_model import model_text

from dehyst.daemon.page.jobs import Setting, look_at_trajectory
from dehyst.models.errors import BadInput

T_S = np.arange(0.0, 1.0, 0.01)
CIRCLE = 4.0 + np.sin(2 * np.pi * T_S), 4.5 + np.cos(2 * np.pi * T_S)


@cache
def axes() -> dict[str, Setting]:
    """Return the settings of three axes, all of the same stage."""
    setting = Setting(
        model=model_text(), unit="um", origin=0.0, reach=(1.3, 10.0), low=0.0, high=95.0,
        slew=1000.0, mode="auto", preview_s=0.05, period_s=0.005,
    )  # fmt: skip
    return {"": setting, "x": setting, "y": setting}


def look(folder: Path, columns: str, *ways: "np.ndarray") -> dict[str, Any]:
    path = folder / "way.csv"
    rows = [",".join(f"{v:.6f}" for v in row) for row in zip(T_S, *ways, strict=True)]
    path.write_text("\n".join([columns, *rows]) + "\n")
    return look_at_trajectory(folder, path, axes(), lambda *_: None)


def test_reach_and_slew_of_each_axis_are_seen(tmp_path: Path) -> None:
    x, y = CIRCLE
    seen = look(tmp_path, "t_s,target_x_um,target_y_um", x, y)
    assert list(seen["axes"]) == ["x", "y"]
    assert (seen["outside"], seen["points"]) == (0.0, 100)
    of_y = seen["axes"]["y"]
    assert (of_y["least"], of_y["most"]) == pytest.approx((3.5, 5.5), abs=1e-3)
    # about 6.3 um/s at roughly 0.1 um/V
    assert 40.0 < of_y["fastest"] < 100.0
    assert all(one["too_fast"] == 0.0 for one in seen["axes"].values())
    np.testing.assert_allclose(np.load(tmp_path / "trajectory.npy"), [T_S, x, y], atol=1e-6)


def test_one_axis_out_of_reach_is_enough(tmp_path: Path) -> None:
    seen = look(tmp_path, "t_s,target_x_um,target_y_um", CIRCLE[0], 10.0 * CIRCLE[1])
    assert seen["axes"]["x"]["outside"] == 0.0
    assert seen["axes"]["y"]["outside"] == seen["outside"] == 1.0


def test_one_axis_alone_is_as_ever(tmp_path: Path) -> None:
    seen = look(tmp_path, "t_s,target_um", CIRCLE[0])
    assert "axes" not in seen
    assert len(seen["target"]) == 100


def test_targets_of_an_axis_that_is_not_there(tmp_path: Path) -> None:
    with pytest.raises(BadInput, match="has targets for w; there is x, y"):
        look(tmp_path, "t_s,target_x_um,target_w_um", *CIRCLE)
