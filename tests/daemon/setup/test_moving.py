"""The steps of a set-up that move the stage, on the simulated one in this process, and what they
conclude."""

import io
import signal
import threading
from pathlib import Path

import numpy as np
import pytest
from rich.console import Console

from dehyst.daemon.files.recordings import read_recording
from dehyst.daemon.rings import run_folder
from dehyst.daemon.setup import moving
from dehyst.daemon.setup.comparison import SinePlan, judged
from dehyst.daemon.setup.journal import Journal
from dehyst.daemon.setup.moving import check_gauge_follows
from dehyst.daemon.setup.questions import UserPrompts, Wishes
from dehyst.daemon.setup.steps import ask_limits, find_units, write_configuration
from dehyst.daemon.setup.workbench import Workbench
from dehyst.models.errors import BadInput, NotNow
from dehyst.models.recording import Recording

CONFIG = """
name = "stage-1"
model = {{file = "stage.model.toml"}}
loop = {{rate_hz = 100.0, priority = 0}}
actuator = {{driver = "simulated", settings = {{stage = "{actuator}"}}}}
sensor = {{driver = "simulated", settings = {{stage = "{sensor}"}}}}
limits = {{min_v = 10.0, max_v = 110.0, slew_v_per_s = 2000.0}}
safe = {{voltage_v = 10.0, ramp_v_per_s = 500.0}}
"""


def workbench(folder: Path, **wishes: object) -> Workbench:
    asking = UserPrompts(True, Console(file=io.StringIO()))
    return Workbench(folder, Wishes(**wishes), Journal(folder), asking, lambda text: None)  # type: ignore[arg-type]


def test_a_gauge_of_another_stage_ends_it_before_the_range_is_used(tmp_path: Path) -> None:
    bench = workbench(tmp_path)
    bench.config_path.write_text(CONFIG.format(actuator="mine", sensor="not mine"))
    with pytest.raises(NotNow, match="the gauge does not follow"):
        moving.exercise_gently(bench)
    (only,) = tmp_path.glob("gentle-*.csv")
    drive = read_recording(only).drive
    assert drive.min() >= 10.0
    assert drive.max() <= 20.0 + 1e-9  # a tenth of the range above its low end


def test_beside_a_daemon_nothing_is_played(tmp_path: Path) -> None:
    bench = workbench(tmp_path)
    bench.config_path.write_text(CONFIG.format(actuator="beside", sensor="beside"))
    before_v, _ = bench.output_now(bench.config())
    folder = bench.config().directory
    with (
        run_folder.at_work(folder, run_folder.OUTPUT, "core", bench.config_path),
        pytest.raises(run_folder.InUse, match=r"in use by process \d+ \(dehyst core of"),
    ):
        moving.exercise_gently(bench)
    assert not list(tmp_path.glob("*.csv"))
    assert bench.output_now(bench.config())[0] == before_v


def test_a_closed_terminal_ends_the_motion_in_order(tmp_path: Path) -> None:
    bench = workbench(tmp_path)
    bench.config_path.write_text(CONFIG.format(actuator="hung up", sensor="hung up"))
    before_v, _ = bench.output_now(bench.config())
    main, usual = threading.main_thread().ident, signal.getsignal(signal.SIGHUP)
    assert main is not None

    def hang_up() -> None:
        if signal.getsignal(signal.SIGHUP) is not usual:  # it would kill this process
            signal.pthread_kill(main, signal.SIGHUP)

    timer = threading.Timer(0.7, hang_up)
    timer.start()
    with pytest.raises(NotNow, match=r"it was interrupted; .*unfinished-1\.csv"):
        moving.exercise_gently(bench)
    timer.join()
    assert read_recording(tmp_path / "unfinished-1.csv").drive.size > 10
    assert bench.output_now(bench.config())[0] == before_v
    assert signal.getsignal(signal.SIGHUP) is usual


def recording(gauge: "np.ndarray[tuple[int], np.dtype[np.float64]]") -> Recording:
    t_s = np.arange(gauge.size) * 0.005
    return Recording(t_s, 5.0 - 5.0 * np.cos(2 * np.pi * t_s), gauge)


def test_what_the_gauge_may_show_and_what_not() -> None:
    t_s = np.arange(1000) * 0.005
    follows = 1.0 - np.cos(2 * np.pi * t_s - 0.2)
    noise = np.random.default_rng(1).normal(0.0, 1.0, 1000)
    assert check_gauge_follows(recording(follows), 10.0) == pytest.approx(0.2, rel=0.05)
    assert check_gauge_follows(recording(-follows), 10.0) < 0  # an inverted gauge is accepted
    for gauge in (noise, np.zeros(1000), np.cos(2 * np.pi * t_s + 1.5)):
        with pytest.raises(NotNow, match="does not follow"):
            check_gauge_follows(recording(gauge), 10.0)
    follows[:20] = np.nan
    with pytest.raises(NotNow, match="no reading in 2%"):
        check_gauge_follows(recording(follows), 10.0)


def test_a_drive_that_only_validates_need_not_excite_enough_for_a_model() -> None:
    few = recording(1.0 - np.cos(2 * np.pi * np.arange(300) * 0.005))
    with pytest.raises(NotNow, match="does not excite enough"):
        moving.judge_recording(few, Path("recording-1.csv"), 200.0)
    said = moving.judge_recording(few, Path("fresh-1.csv"), 200.0, identified=False)["words"]
    assert said.startswith("fresh-1.csv: 300 samples, 0 too late")
    assert "model" not in said


def test_the_comparison_pairs_a_reading_with_the_target_of_the_voltage_in_force() -> None:
    """A reading is compared with the target of the voltage in force. If the stage is always where
    that voltage puts it, 0.3 um off, no error is left, even where samples were late."""
    rate_hz, f_hz = 200.0, 1.0
    t_s = np.arange(1201) / rate_hz
    target = 5.0 - 4.0 * np.cos(2 * np.pi * f_hz * t_s)
    plan = SinePlan(t_s, target, {}, f_hz, "um")
    rows = np.delete(np.arange(1201), [500, 501, 777])
    before = np.concatenate([[0], rows[:-1]])
    found = Recording(t_s[rows] + 2e-4, np.zeros(rows.size), target[before] + 0.3)
    times, wanted, measured = judged(plan, found, rate_hz)
    assert times[0] >= 2.0
    assert measured.size == pytest.approx(800, abs=5)
    assert np.abs(measured - wanted).max() < 1e-12


@pytest.mark.parametrize("seed", [0, 1])
@pytest.mark.parametrize("slew", [100.0, 2000.0])
def test_the_drive_stays_within_limits_and_slew(tmp_path: Path, seed: int, slew: float) -> None:
    bench = workbench(tmp_path, seconds=60.0 if slew < 1000 else 10.0)
    text = CONFIG.format(actuator="a", sensor="a").replace("2000.0", f"{slew}")
    bench.config_path.write_text(text.replace("ramp_v_per_s = 500.0", "ramp_v_per_s = 50.0"))
    drive = moving.drive_for(bench.config(), bench.wishes, seed)
    assert drive.u.min() >= 10.0
    assert drive.u.max() <= 110.0
    assert np.abs(np.diff(drive.u) * 100.0).max() <= slew
    said = moving.describe_drive(bench, seed)
    assert f"{drive.u.min():.4g} to {drive.u.max():.4g} V" in said


@pytest.mark.parametrize(
    ("wishes", "said"),
    [
        ({"band_hz": 9.0}, "--band 9: sampling rate: 100 Hz is too low for a band of 13.5 Hz"),
        ({"seconds": 2.5}, "--duration 2.5: duration: 2.5 s is too short for 2 sines"),
        ({"seconds": 3.3, "band_hz": 1.0}, "too short for 3 sines"),  # those of the validation
    ],
)
def test_a_drive_that_cannot_be_designed_is_refused_before_anything_moves(
    tmp_path: Path, wishes: dict[str, float], said: str
) -> None:
    bench = workbench(tmp_path, **wishes)
    bench.config_path.write_text(CONFIG.format(actuator="still", sensor="still"))
    for describe in (moving.describe_gentle, lambda bench: moving.describe_drive(bench, 0)):
        with pytest.raises(BadInput, match=said):
            describe(bench)


def found_units(bench: Workbench) -> None:
    unit = {"driver": "mdt693b", "port": "/dev/x", "minimum": 0.0, "maximum": 75.0}
    sensor = {"driver": "ksg101", "port": "/dev/y", "minimum": -20.0, "maximum": 20.0}
    result = {"words": "", "axis": "y", "actuator": unit, "sensor": sensor, "sustained_hz": 220.0}
    bench.journal.keep("units", {}, result)


def test_limits_are_asked_for_and_lie_within_the_unit(tmp_path: Path) -> None:
    bench = workbench(tmp_path)
    found_units(bench)
    with pytest.raises(BadInput, match="--yes needs --range MIN MAX: the lowest voltage of the"):
        ask_limits(bench)
    for low, high in ((0.0, 100.0), (-1.0, 50.0), (50.0, 50.0), (0.0, float("nan"))):
        bench.wishes = Wishes(range_v=(low, high))
        with pytest.raises(BadInput, match="the amplifier gives 0 to 75 V"):
            ask_limits(bench)
    bench.wishes = Wishes(range_v=(5.0, 75.0))
    assert ask_limits(bench)["slew_v_per_s"] == 1400.0


def test_the_configuration_says_what_was_found_and_asked(tmp_path: Path) -> None:
    bench = workbench(tmp_path, range_v=(5.0, 75.0))
    found_units(bench)
    bench.journal.keep("limits", {}, ask_limits(bench))
    assert write_configuration(bench)["rate_hz"] == 200.0
    config = bench.config()
    assert config.actuator.settings == {"port": "/dev/x", "axis": "y"}
    assert (config.limits.min_v, config.safe.voltage_v) == (5.0, 5.0)
    bench.wishes = Wishes(rate_hz=400.0)
    with pytest.raises(BadInput, match="time for late replies only up to 220 Hz"):
        write_configuration(bench)


def test_a_configuration_of_ones_own_is_used_as_it_stands(tmp_path: Path) -> None:
    bench = workbench(tmp_path)
    bench.config_path.write_text(text := CONFIG.format(actuator="a", sensor="a"))
    assert "stage.toml" in find_units(bench)["words"]
    assert ask_limits(bench)["words"].startswith("10 to 110 V")
    assert write_configuration(bench)["rate_hz"] == 100.0
    assert bench.config_path.read_text() == text
