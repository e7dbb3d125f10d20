"""`dehyst scan`: the file, the picture, and what is refused before anything is written."""

import json
import re
from pathlib import Path

import numpy as np
import pytest
from tests.rigs.gateway_bench import free_port

from dehyst.daemon.bench.simulated import write_axes_bench
from dehyst.daemon.files.models import save_model
from dehyst.daemon.files.recordings import read_columns
from dehyst.daemon.main import main
from dehyst.models.model import Block, Hysteresis, Model, Validity

PORTS = {"mdt693b": "/dev/a", "ksg101-x": "/dev/x", "ksg101-y": "/dev/y"}


@pytest.fixture(autouse=True)
def _nobody_there(monkeypatch: pytest.MonkeyPatch) -> None:
    """Use a free port: on this machine a daemon may run at the default address."""
    monkeypatch.setenv("DEHYST_CONNECT", f"tcp/127.0.0.1:{free_port()}")


def straight(um_per_v: float, *blocks: Block) -> Model:
    """Return the model of a stage without hysteresis."""
    line = Hysteresis(r=np.zeros(1), b=np.array([um_per_v]), k=np.zeros(1), c=np.array([0.0, 1.0]))
    return Model(line, Validity(0.0, 150.0), blocks=blocks)


@pytest.fixture(scope="module")
def config(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Configure axes x from 0 to 15 um and y from 0 to 9 um; x moves with y."""
    block = Block("coupling", "stage", {"gain_um_per_unit": 0.2, "reference": 0.0}, "axis.y")
    models = {"x": straight(0.1, block), "y": straight(0.06)}
    folder = tmp_path_factory.mktemp("scan")
    return write_axes_bench(folder, PORTS, "bench", "tcp/127.0.0.1:7447", models)


def test_a_raster_about_the_middle_of_the_reach(
    config: Path, tmp_path: Path, capsys: pytest.CaptureFixture
) -> None:
    out, png = tmp_path / "raster.csv", tmp_path / "raster.png"
    words = ["scan", "raster", "--size", "5", "4", "--lines", "6", "--config", str(config)]
    assert main([*words, "-o", str(out), "--picture", str(png), "--json"]) == 0
    facts = json.loads(capsys.readouterr().out)
    columns, _ = read_columns(out)
    assert list(columns) == ["t_s", "target_x_um", "target_y_um", "scan"]
    lines = columns["scan"] > 0
    x, y = columns["target_x_um"], columns["target_y_um"]
    assert (x[lines].min(), x[lines].max()) == pytest.approx((5.0, 10.0), abs=0.15)
    assert (y.min(), y.max()) == pytest.approx((2.5, 6.5), abs=1e-6)
    assert np.diff(columns["t_s"]) == pytest.approx(0.01)  # the loop's period
    assert facts["checked"] == ["x", "y"]
    assert facts["samples"] == x.size
    assert png.read_bytes()[:4] == b"\x89PNG"


@pytest.mark.parametrize(
    ("words", "says"),
    [
        (["raster", "--size", "5", "10"], "axis y: the path goes from -0.5 to 9.5 um"),
        (["raster", "--size", "14.2", "4", "--turn", "0.05"], "axis x: .* out of reach"),
        (
            ["raster", "--size", "6", "4", "--line-s", "0.015", "--sampling", "1000"],
            "axis x: .*slew limit",
        ),
        (["raster"], "--size W H"),
        (["spiral"], "--radius"),
        (["lissajous", "--size", "1", "1", "--axes", "x", "q"], "no axis q; it has x, y"),
        (["lissajous", "--size", "1", "1", "--axes", "x", "x"], "two axes"),
        (["lissajous", "--size", "1", "1", "--unit", "nm"], "axis x is in um"),
        (["lissajous", "--size", "1", "1", "--model", "x", "m"], "without --config"),
    ],
)
def test_what_cannot_be_followed_is_not_written(
    config: Path, tmp_path: Path, words: list[str], says: str, capsys: pytest.CaptureFixture
) -> None:
    """A path that the stage cannot follow is refused in one line and no file is written. The second
    one is out of reach only because of what y adds to x: 0.2 times 2.5 to 6.5 um."""
    out = tmp_path / "path.csv"
    assert main(["scan", *words, "--config", str(config), "-o", str(out)]) == 2
    error = capsys.readouterr().err
    assert error.count("\n") == 1
    assert re.search(says, error), error
    assert not out.exists()


def test_without_a_configuration(tmp_path: Path, capsys: pytest.CaptureFixture) -> None:
    out = tmp_path / "spiral.csv"
    assert main(["scan", "spiral", "--radius", "2", "--center", "8", "9", "-o", str(out)]) == 0
    said = capsys.readouterr()
    assert "not checked" in said.err
    assert "centred at" not in said.err
    beside = str(tmp_path / "beside.csv")
    assert main(["scan", "spiral", "--radius", "2", "-o", beside]) == 0
    assert "centred at (0, 0), which may be out of the stage's reach" in capsys.readouterr().err
    columns, _ = read_columns(out)
    assert columns["target_x_um"][0] == pytest.approx(8.0)
    assert columns["target_y_um"].max() == pytest.approx(11.0, abs=0.2)  # a turn before the end
    for axis in "xy":
        save_model(straight(0.06), tmp_path / f"{axis}.toml")
    words = ["scan", "lissajous", "--size", "20", "2", "-o", str(tmp_path / "f.csv")]
    for axis in "xy":
        words += ["--model", axis, str(tmp_path / f"{axis}.toml")]
    assert main(words) == 2
    assert "the axis from 0 to 9" in capsys.readouterr().err
