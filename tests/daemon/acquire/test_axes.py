"""Open-loop recording of several axes on the simulated stage, in virtual time."""

from pathlib import Path

import numpy as np
import pytest

from dehyst.daemon.acquire.axes import PACES, acquire_axes, plan_axes
from dehyst.daemon.bench.simulated import exploring_drive
from dehyst.daemon.config import Controller, load_controller
from dehyst.drivers.simulated.devices import SimulatedActuator
from dehyst.models.errors import BadRecording
from dehyst.models.recording import Floats

RATE_HZ = 1000.0
SHARED = """
name = "stage-1"
run_dir = "{run}"
loop = {{rate_hz = 1000.0}}
limits = {{min_v = 0.0, max_v = {max_v}, slew_v_per_s = 4000.0}}
safe = {{ramp_v_per_s = 4000.0}}
"""
AXIS = """
[axis.{axis}]
model = {{file = "model.toml"}}
[axis.{axis}.actuator]
driver = "simulated"
settings = {{stage = "{name}", axis = "{axis}", period_s = 1e-3}}
[axis.{axis}.sensor]
driver = "simulated"
settings = {{stage = "{name}", axis = "{axis}", {more}}}
"""
MORE = {"x": "from_y = 0.03, stroke_um = 15.0", "y": "from_x = -0.02, stroke_um = 12.0"}


def controller(folder: Path, name: str, max_v: float = 150.0) -> Controller:
    path = folder / "stage.toml"
    text = SHARED.format(run=folder / "run", max_v=max_v)
    text += "".join(AXIS.format(axis=a, name=name, more=more) for a, more in MORE.items())
    path.write_text(text)
    return load_controller(path)


def drive() -> tuple[Floats, Floats]:
    t_s, volts = exploring_drive(RATE_HZ, 1.2)
    return t_s, 0.4 * volts


def test_the_plan_moves_one_axis_after_the_other_then_all(tmp_path: Path) -> None:
    t_s, volts = exploring_drive(RATE_HZ, 12.0)
    times, plan = plan_axes(controller(tmp_path, "plan").axes, t_s, volts)
    moves = np.abs(np.diff(plan, axis=0, prepend=plan[:1])) > 0
    assert not np.any(moves[times < 12.0, 1])
    assert not np.any(moves[(times > 12.05) & (times < 24.0), 0])
    both = times > 24.1
    assert np.all(moves[both].sum(axis=0) > 10_000)
    assert np.abs(np.corrcoef(plan[both].T)[0, 1]) < 0.3
    # alone at the drive's own pace, together at the pace of the axis
    np.testing.assert_allclose(plan[: t_s.size, 0], volts, atol=1e-9)
    begun = 2 * (12.0 + 1e-3)  # after both, each with one sample for the return
    expected = np.interp((times[both] - begun) * PACES[1], t_s, volts)
    np.testing.assert_allclose(plan[both, 1], expected, atol=2.0)


def test_each_axis_has_its_recording_with_the_others_as_channels(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    now = [0]
    acquiring = "dehyst.daemon.acquire.one_axis"
    monkeypatch.setattr(f"{acquiring}.sleeper", lambda: lambda due: now.append(due))
    monkeypatch.setattr(f"{acquiring}.clock.monotonic_ns", lambda: now[-1])
    axes = controller(tmp_path, "acquired").axes
    held = SimulatedActuator.from_settings({"stage": "acquired", "axis": "x", "period_s": 1e-3})
    found, ended = acquire_axes(axes, *drive(), exercise_s=0.5)
    assert ended == ""
    x, y = found["x"], found["y"]
    assert list(x.channels) == ["axis.y", "axis.y.drive"]
    np.testing.assert_array_equal(x.channels["axis.y"], y.displacement)
    np.testing.assert_array_equal(y.channels["axis.x.drive"], x.drive)
    alone = slice(1300, 2300)  # y moves, x rests: the reading of x is coupling from y, and creep
    assert np.ptp(x.drive[alone]) == 0.0
    assert x.displacement is not None
    assert y.displacement is not None
    moved, brought = y.displacement[alone], x.displacement[alone]
    assert np.polyfit(moved, brought, 1)[0] == pytest.approx(0.03, abs=0.003)
    assert held.shared.stage.command_v == pytest.approx(0.0, abs=1e-9)  # back where it was


def test_what_an_axis_forbids_is_refused_before_anything_moves(tmp_path: Path) -> None:
    with pytest.raises(BadRecording, match="axis x: the drive spans"):
        plan_axes(controller(tmp_path, "refused", 30.0).axes, *drive())
