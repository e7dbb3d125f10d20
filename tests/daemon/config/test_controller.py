"""One file with several axes: the configuration of each axis, and what is refused with a reason."""

from pathlib import Path

import pytest

from dehyst.daemon.config import load_config, load_controller
from dehyst.daemon.main import main
from dehyst.models.errors import BadInput

ONE = """
name = "stage-1"
run_dir = "{run}"
model = {{file = "paper-eq11"}}
actuator = {{driver = "simulated"}}
sensor = {{driver = "simulated"}}
limits = {{min_v = 0.0, max_v = 10.0, slew_v_per_s = 500.0}}
"""
THREE = """
name = "stage-1"
run_dir = "{run}"
[loop]
rate_hz = 250.0
[model]
file = "paper-eq11"
[actuator]
driver = "mdt693b"
gain = 15.0
settings = {{port = "/dev/ttyACM0"}}
[sensor]
driver = "ksg101"
[limits]
min_v = 0.0
max_v = 150.0
slew_v_per_s = 4000.0
[safe]
voltage_v = 75.0
[watch]
directory = "/var/kept"
[axis.x]
actuator.settings.axis = "x"
sensor.settings.port = "/dev/ttyUSB0"
[axis.y]
actuator.settings.axis = "y"
sensor.settings.port = "/dev/ttyUSB1"
limits.max_v = 100.0
safe = {{voltage_v = 0.0}}
watch.directory = "/var/y"
channels.u1_v = {{axis = "x", quantity = "drive"}}
[axis.z]
actuator = {{driver = "simulated", settings = {{stage = "z"}}}}
sensor = {{driver = "simulated", settings = {{stage = "z"}}}}
"""


def wrote(folder: Path, text: str) -> Path:
    path = folder / "stage.toml"
    path.write_text(text.format(run=folder / "run"))
    return path


def test_a_file_of_one_axis_is_as_ever(tmp_path: Path) -> None:
    path = wrote(tmp_path, ONE)
    controller = load_controller(path)
    assert controller.axes == (load_config(path),)
    assert (controller.name, controller.axes[0].name) == ("stage-1", "stage-1")
    assert controller.directory == controller.axes[0].directory == tmp_path / "run"
    assert controller.axis_names == ("",)


def test_each_axis_is_a_configuration_of_its_own(tmp_path: Path) -> None:
    controller = load_controller(wrote(tmp_path, THREE))
    x, y, z = controller.axes
    assert controller.directory == tmp_path / "run"
    assert [c.name for c in controller.axes] == ["stage-1-x", "stage-1-y", "stage-1-z"]
    assert [c.directory for c in controller.axes] == [tmp_path / "run" / a for a in "xyz"]
    assert {c.loop.rate_hz for c in controller.axes} == {250.0} == {controller.loop.rate_hz}
    # tables are merged, down to the settings
    assert x.actuator.settings == {"port": "/dev/ttyACM0", "axis": "x"}
    assert y.actuator.settings == {"port": "/dev/ttyACM0", "axis": "y"}
    assert x.actuator.gain == y.actuator.gain == 15.0
    assert (x.limits.max_v, y.limits.max_v, y.limits.slew_v_per_s) == (150.0, 100.0, 4000.0)
    assert (x.safe.voltage_v, y.safe.voltage_v) == (75.0, 0.0)
    # another driver does not inherit gain and settings of the shared one
    assert (z.actuator.gain, z.actuator.settings) == (1.0, {"stage": "z"})
    # the slowest ramp to a safe voltage at 50 V/s: y, 100 V; x needs 75 V
    assert controller.longest_ramp_s == pytest.approx(2.0)
    # recordings of several axes are kept in separate folders
    assert [str(c.watch_directory) for c in (x, y)] == ["/var/kept/x", "/var/y"]


def test_a_channel_may_follow_another_axis(tmp_path: Path) -> None:
    y = load_controller(wrote(tmp_path, THREE)).axes[1]
    assert (y.channels["u1_v"].axis, y.channels["u1_v"].quantity) == ("x", "drive")


def test_a_command_for_one_axis_asks_which(tmp_path: Path) -> None:
    path = wrote(tmp_path, THREE)
    with pytest.raises(BadInput, match="axes x, y, z; choose one with --axis"):
        load_config(path)
    assert load_config(path, "y").name == "stage-1-y"
    with pytest.raises(BadInput, match="no axis 'w'; it has the axes x, y, z"):
        load_config(path, "w")
    with pytest.raises(BadInput, match="it has one axis, without a name"):
        load_config(wrote(tmp_path, ONE), "x")


@pytest.mark.parametrize(
    ("old", "new", "words"),
    [
        ("[axis.y]", "[axis.y]\nloop.rate_hz = 10.0", "axis y: `loop` is for all axes"),
        ("[axis.y]", "[axis.y]\nname = 'other'", "axis y: `name` is for all axes"),
        (
            "[axis.y]",
            "[axis.y]\nlimmits = 1",
            "unknown key axis.y.limmits; known keys of [axis.y]: model",
        ),
        ("[loop]", "[loops]", "unknown key loops; known keys at top level: name"),
        ("[axis.y]", "[axis.y]\nlimits.min_v = 120.0", "axis y: limits.max_v must be greater"),
        ("[axis.y]", "[axis.Y]", "axis 'Y': a name has"),
        ("[axis.y]", "[axis.longername]", "axis 'longername': a name has"),
        ('settings.axis = "y"', 'settings.axis = "x"', "x and y have the same actuator"),
        ("ttyUSB1", "ttyUSB0", "x and y have the same sensor"),
        (
            '{{axis = "x", q',
            '{{axis = "w", q',
            "channels.u1_v follows axis w; the axes are: x, y, z",
        ),
        ('{{axis = "x", q', '{{axis = "y", q', "channels.u1_v follows its own axis"),
        ('{{axis = "x", q', "{{q", "channels.u1_v needs one of `driver`"),
        ('name = "stage-1"', "", "the key name is missing"),
        ("[axis.z]", "[axis]\nw = 3\n[axis.z]", "axis.w must be a table"),
    ],
)
def test_what_cannot_be_is_refused(tmp_path: Path, old: str, new: str, words: str) -> None:
    assert old in THREE
    with pytest.raises(BadInput) as refused:
        load_controller(wrote(tmp_path, THREE.replace(old, new)))
    assert words in str(refused.value)
    assert "\n" not in str(refused.value)


def test_a_stage_of_one_axis_follows_no_other(tmp_path: Path) -> None:
    with pytest.raises(BadInput, match="has one axis only"):
        load_controller(wrote(tmp_path, ONE + '[channels.u2_v]\naxis = "y"\n'))


def test_check_tells_of_every_axis(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    simulated = 'driver = "simulated", settings = {{stage = "%s"}}'
    text = ONE.replace("paper-eq11", "paper-eq12")
    for axis in "xy":
        device = simulated % axis
        text += f"[axis.{axis}]\nactuator = {{{{{device}}}}}\nsensor = {{{{{device}}}}}\n"
    path = wrote(tmp_path, text)
    assert main(["run", "--check", str(path)]) == 0
    reported = capsys.readouterr()
    for axis in "xy":
        _, words = reported.out.split(f"stage-1-{axis}:\n")
        assert "set-points from" in words
    path = wrote(tmp_path, text + "limits = {max_v = 1e5}\n".replace("{", "{{").replace("}", "}}"))
    assert main(["run", "--check", str(path)]) == 2
    assert "axis y: limits" in capsys.readouterr().err
