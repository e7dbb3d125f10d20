"""Set-up of several axes: on simulated devices in virtual time, and as a process on emulated units
whose gauge readers are named in another order."""

import io
import json
from pathlib import Path

import numpy as np
import pytest
from rich.console import Console
from tests.rigs.processes import EmulatedBench, set_up

from dehyst.daemon.config import load_controller
from dehyst.daemon.files.models import load_model
from dehyst.daemon.files.recordings import read_recording
from dehyst.daemon.rings import run_folder
from dehyst.daemon.setup.axes_steps import AXES_STEPS, write_axes_configuration
from dehyst.daemon.setup.journal import Journal
from dehyst.daemon.setup.moving_axes import (
    describe_gentle_axes,
    describe_record,
    find_owners,
    record_axes_in_turn,
    small_loops,
    whose_gauges,
)
from dehyst.daemon.setup.names import NAMES
from dehyst.daemon.setup.questions import UserPrompts, Wishes
from dehyst.daemon.setup.sequence import do_steps
from dehyst.daemon.setup.steps import STEPS
from dehyst.daemon.setup.workbench import Workbench
from dehyst.models.errors import BadInput, NotNow
from dehyst.models.recording import Recording

SHARED = """
name = "stage-1"
loop = {{rate_hz = 100.0, priority = 0}}
limits = {{min_v = 10.0, max_v = {max_v}, slew_v_per_s = 3000.0}}
safe = {{voltage_v = 10.0, ramp_v_per_s = 3000.0}}
"""
AXIS = """
[axis.{axis}]
model = {{file = "stage-{axis}.model.toml"}}
actuator.driver = "simulated"
actuator.settings = {{stage = "{name}", axis = "{axis}", period_s = 1e-2}}
sensor = {{driver = "simulated", settings = {{stage = "{name}", axis = "{gauge}", {more}}}}}
"""
MORE = {"x": "from_y = 0.03, stroke_um = 15.0", "y": "from_x = -0.02, stroke_um = 12.0"}


def workbench(folder: Path, **wishes: object) -> Workbench:
    asking = UserPrompts(True, Console(file=io.StringIO()))
    said: list[str] = []
    bench = Workbench(folder, Wishes(**wishes), Journal(folder), asking, said.append)  # type: ignore[arg-type]
    return bench


def own_config(bench: Workbench, name: str, gauges: str = "xy", max_v: float = 110.0) -> None:
    text = SHARED.format(max_v=max_v)
    for axis, gauge in zip("xy", gauges, strict=True):
        text += AXIS.format(axis=axis, gauge=gauge, name=name, more=MORE[gauge])
    bench.config_path.write_text(text)


@pytest.fixture
def virtual_time(monkeypatch: pytest.MonkeyPatch) -> None:
    now = [0]
    acquiring = "dehyst.daemon.acquire.one_axis"
    monkeypatch.setattr(f"{acquiring}.sleeper", lambda: lambda due: now.append(due))
    monkeypatch.setattr(f"{acquiring}.clock.monotonic_ns", lambda: now[-1])


def test_the_steps_have_the_names_of_one_axis_and_move_where_those_do() -> None:
    assert tuple(step.name for step in AXES_STEPS) == NAMES
    moving = [step.name for step in AXES_STEPS if step.moves is not None]
    assert moving == ["exercise", "record", "validate", "track"]
    assert [s.options for s in AXES_STEPS] == [s.options for s in STEPS]


def test_a_drive_that_cannot_be_designed_is_refused_before_anything_moves(tmp_path: Path) -> None:
    bench = workbench(tmp_path, band_hz=9.0)
    own_config(bench, "still")
    for describe in (describe_gentle_axes, describe_record):
        with pytest.raises(BadInput, match="--band 9: sampling rate: 100 Hz is too low"):
            describe(bench)


@pytest.mark.usefixtures("virtual_time")
def test_two_axes_from_their_configuration_to_followed_sines(tmp_path: Path) -> None:
    bench = workbench(tmp_path, seconds=6.0)
    own_config(bench, "whole")
    do_steps(bench)
    tracked = bench.journal.result("track")["axes"]
    for axis, brings in (("x", 0.03), ("y", -0.02)):
        assert tracked[axis]["times_smaller"] >= 3.0
        assert bench.journal.result("validate")["axes"][axis]["share_of_span"] < 0.01
        model = load_model(tmp_path / f"stage-{axis}.model.toml")
        (coupling,) = [block for block in model.blocks if block.channel]
        assert coupling.params["gain_um_per_unit"] == pytest.approx(brings, abs=0.005)
        for name in (f"tracking-{axis}.png", f"report-{axis}.html", f"validation-{axis}.html"):
            assert (tmp_path / name).stat().st_size > 1000
        drives = [read_recording(p).drive for p in tmp_path.glob(f"*-{axis}-*.csv")]
        assert min(d.min() for d in drives) >= 10.0 - 1e-9
        assert max(d.max() for d in drives) <= 110.0 + 1e-9
    # all is done and nothing is repeated: the same recordings
    files = {path.name for path in tmp_path.iterdir()}
    do_steps(workbench(tmp_path, seconds=6.0))
    assert {path.name for path in tmp_path.iterdir()} == files


@pytest.mark.usefixtures("virtual_time")
def test_exchanged_gauges_in_ones_own_configuration_end_it_before_the_range_is_used(
    tmp_path: Path,
) -> None:
    bench = workbench(tmp_path)
    own_config(bench, "exchanged", gauges="yx")
    with pytest.raises(BadInput, match="x moves the gauge of y, y moves the gauge of x"):
        do_steps(bench, until="exercise")
    for path in tmp_path.glob("gentle-*.csv"):
        assert read_recording(path).drive.max() <= 20.0 + 1e-9


def test_beside_a_daemon_no_axis_is_recorded(tmp_path: Path) -> None:
    bench = workbench(tmp_path)
    own_config(bench, "beside a daemon")
    folder = load_controller(bench.config_path).directory
    for step in (record_axes_in_turn, find_owners):
        with (
            run_folder.at_work(folder, run_folder.OUTPUT, "core", bench.config_path),
            pytest.raises(run_folder.InUse),
        ):
            step(bench)
    assert not list(tmp_path.glob("*.csv"))


def test_small_loops_move_one_axis_at_a_time(tmp_path: Path) -> None:
    bench = workbench(tmp_path)
    own_config(bench, "small")
    t_s, volts, rows = small_loops(list(bench.configs().values()))
    assert volts.min() == 10.0
    assert volts.max() <= 20.0 + 1e-9
    for k, part in enumerate(rows):
        assert np.ptp(volts[part, k]) > 9.9
        assert np.ptp(volts[part, 1 - k]) == 0.0
    assert t_s.size == sum(part.stop - part.start for part in rows)


def test_a_gauge_that_two_axes_move_or_none_is_refused() -> None:
    t_s = np.arange(400) * 0.01
    wave = 5.0 - 5.0 * np.cos(2 * np.pi * t_s)
    first, second = np.where(t_s < 2.0, wave, 0.0), np.where(t_s >= 2.0, wave, 0.0)
    windows = [(0.0, 2.0), (2.0, 4.0)]
    still = np.random.default_rng(1).normal(0.0, 1e-3, 400)

    def found(x: "np.ndarray", y: "np.ndarray") -> dict[str, str]:
        drives = {"x": (first, x), "y": (second, y)}
        return whose_gauges({a: Recording(t_s, d, m) for a, (d, m) in drives.items()}, windows)

    assert found(first + 0.02 * second, second) == {"x": "x", "y": "y"}
    assert found(second, first + 0.02 * second) == {"x": "y", "y": "x"}
    with pytest.raises(NotNow, match="the axes x, y move the same gauge most"):
        found(first + second, still)
    with pytest.raises(NotNow, match="axis y: the gauge does not follow"):
        found(first, still)
    with pytest.raises(NotNow, match="axis x: the gauge gave no reading"):
        found(np.full(400, np.nan), np.full(400, np.nan))


def test_one_file_says_what_is_for_all_axes_and_what_is_an_axis_own(tmp_path: Path) -> None:
    bench = workbench(tmp_path, axes=("x", "z"))
    gauges = {axis: {"driver": "ksg101", "port": f"/dev/{axis}"} for axis in "xz"}
    unit = {"driver": "mdt693b", "port": "/dev/a", "minimum": 0.0, "maximum": 75.0}
    units = {"words": "", "axes": ["x", "z"], "actuator": unit, "sensors": gauges}
    bench.journal.keep("units", {}, units | {"sustained_hz": 130.0})
    limits = {"words": "", "min_v": 0.0, "max_v": 60.0, "slew_v_per_s": 900.0}
    bench.journal.keep("limits", {}, limits)
    assert write_axes_configuration(bench)["rate_hz"] == 120.0  # rounded down from 123.5
    controller = load_controller(bench.config_path)
    assert controller.axis_names == ("x", "z")
    for config in controller.axes:
        assert config.actuator.settings == {"port": "/dev/a", "axis": config.axis}
        assert config.sensor.settings == {"port": f"/dev/{config.axis}"}
        assert (config.limits.max_v, config.loop.rate_hz) == (60.0, 120.0)
        assert config.model.file == str(tmp_path / f"stage-{config.axis}.model.toml")


@pytest.mark.timing
def test_the_gauge_readers_are_distinguished_by_what_moves_them(tmp_path: Path) -> None:
    """`dehyst setup --axes 3` assigns each gauge reader to the axis that moves it, although the
    ports are given in another order. It runs up to the gentle loops."""
    bench = EmulatedBench(tmp_path, "--axes", "3")
    try:
        ports = [bench.ports[name] for name in ("ksg101-z", "ksg101-x", "mdt693b", "ksg101-y")]
        words = [str(tmp_path / "stage"), "--yes", "--json", "--axes", "3"]
        words += ["--range", "0", "140", "--until", "exercise", "--ports", *ports]
        process, out, err = set_up(*words)
        _, volts = bench.output()
    finally:
        bench.close()
    assert process.returncode == 0, err
    assert "x moves the gauge of y, y moves the gauge of z, z moves the gauge of x" in err
    controller = load_controller(tmp_path / "stage" / "stage.toml")
    assert [c.sensor.settings["port"][-1] for c in controller.axes] == ["x", "y", "z"]
    strokes = {a: one["stroke"] for a, one in json.loads(out)["exercise"]["axes"].items()}
    assert all(10.0 < stroke < 20.0 for stroke in strokes.values())
    assert volts.min() >= -3e-3
    assert volts.max() <= 140.0 + 3e-3
