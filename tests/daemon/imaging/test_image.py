"""`dehyst image`: the required improvements, equal figures in two runs, the files, and what is
refused."""

import json
import sys
from pathlib import Path
from typing import Any

import h5py
import numpy as np
import pytest

from dehyst.daemon.imaging.experiment import image
from dehyst.daemon.imaging.report import pictures_to_json
from dehyst.daemon.main import main

LINES = "12"  # the results do not depend on their number


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    out = tmp_path_factory.mktemp("image") / "made"
    assert main(["image", "-o", str(out), "--lines", LINES]) == 0
    return out


@pytest.fixture(scope="module")
def facts(folder: Path) -> dict[str, Any]:
    return json.loads((folder / "image.json").read_text())


def test_compensated_and_learned_are_as_much_better_as_they_must_be(facts: dict[str, Any]) -> None:
    raw, compensated, learned = facts["pictures"].values()
    assert compensated["distortion_nm"] * 10.0 <= raw["distortion_nm"]
    assert learned["distortion_nm"] * 30.0 <= raw["distortion_nm"]
    assert raw["seam_nm"] > compensated["seam_nm"] > learned["seam_nm"]
    assert raw["distortion_percent"] == pytest.approx(raw["distortion_nm"] / 8000.0 * 100.0)
    assert facts["reached"] is True


def test_two_runs_give_the_same_figures(facts: dict[str, Any]) -> None:
    assert pictures_to_json(image(lines=int(LINES))) == facts


def test_the_distortion_is_that_of_the_places_in_the_file(
    folder: Path, facts: dict[str, Any]
) -> None:
    """The reported distortion agrees with least squares over the file's own columns, where the
    lines run at constant speed."""
    with h5py.File(folder / "image.h5") as file:
        for name, said in facts["pictures"].items():
            square = 0.0
            x = file[f"entry/instrument/{name}_x/target_value"][()]
            way = np.abs(np.gradient(x))
            lines = np.isclose(way, 8.0 / 160.0, rtol=1e-6)
            for axis in "xy":
                stage = file[f"entry/instrument/{name}_{axis}"]
                wanted, true = (stage[k][()][lines] for k in ("target_value", "true_value"))
                fit = np.polyfit(wanted, true, 1)
                square += float(np.mean((true - np.polyval(fit, wanted)) ** 2))
            assert 1e3 * np.sqrt(square) == pytest.approx(said["distortion_nm"], rel=0.05)


def test_the_file_is_found_by_nexus_names(folder: Path) -> None:
    with h5py.File(folder / "image.h5") as file:
        assert file.attrs["NX_class"] == "NXroot"
        entry = file[file.attrs["default"]]
        assert entry.attrs["NX_class"] == "NXentry"
        data = entry[entry.attrs["default"]]
        assert data.attrs["NX_class"] == "NXdata"
        signal = data[data.attrs["signal"]]
        assert signal.attrs["units"] == "nm"
        for place, axis in enumerate(data.attrs["axes"]):
            assert data[axis].shape == (signal.shape[place],)
            assert data[axis].attrs["units"] == "um"
            assert data.attrs[f"{axis}_indices"] == place


def test_the_pictures_are_one_png(folder: Path) -> None:
    png = (folder / "image.png").read_bytes()
    assert png.startswith(b"\x89PNG")
    assert int.from_bytes(png[16:20]) > 1000  # wide enough for three pictures


def test_without_h5py_the_pictures_are_made_and_it_says_what_is_missing(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture
) -> None:
    monkeypatch.setitem(sys.modules, "h5py", None)  # as if not installed
    assert main(["image", "-o", str(tmp_path), "--lines", "8"]) == 0
    assert sorted(p.name for p in tmp_path.iterdir()) == ["image.json", "image.png"]
    assert "dehyst[hdf5]" in capsys.readouterr().err


@pytest.mark.parametrize("lines", ["7", "9", "0", "-4", "2000"])
def test_lines_that_make_no_picture_are_refused(
    lines: str, tmp_path: Path, capsys: pytest.CaptureFixture
) -> None:
    assert main(["image", "-o", str(tmp_path), f"--lines={lines}"]) == 2
    assert "--lines: an even number" in capsys.readouterr().err
    assert not list(tmp_path.iterdir())
