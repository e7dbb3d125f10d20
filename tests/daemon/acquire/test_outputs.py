"""How `acquire` drives its outputs, on Python objects: the steps of the writes, and the return."""

import os
import signal
import sys
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from dehyst.daemon import clock
from dehyst.daemon.acquire.axes import play_axes
from dehyst.daemon.acquire.early_end import signals_noted
from dehyst.daemon.acquire.one_axis import acquire
from dehyst.daemon.config import Controller, load_controller
from dehyst.daemon.files.recordings import write_recording
from dehyst.daemon.main import main
from dehyst.daemon.rings import run_folder
from dehyst.daemon.rings.records import TELEMETRY
from dehyst.daemon.rings.ring import Ring
from dehyst.models.drive_design.excitation import design
from dehyst.models.recording import Floats

RATE_HZ, SLEW, RAMP = 256.0, 512.0, 128.0  # steps of 2 V and of 0.5 V: no rounding
CONFIG = """
name = "outputs"
run_dir = "{run}"
loop = {{rate_hz = 256.0, priority = 0}}
limits = {{min_v = 0.0, max_v = 100.0, slew_v_per_s = 512.0}}
safe = {{voltage_v = 0.0, ramp_v_per_s = 128.0}}
"""
DEVICES = """
{head}
model = {{file = "paper-eq11"}}
sensor = {{driver = "simulated", settings = {{stage = "outputs", axis = "{name}"}}}}
[{axis}actuator]
driver = "python"
[{axis}actuator.settings]
object = "an_amplifier:make"
write = "write"
write_arguments = ["{name}"]
max_v = 100.0
max_rate_hz = 1000.0
{more}
"""
KNOWN, BLIND = 'output = "output"\noutput_arguments = ["{name}"]', "initial_v = 0.0"


class Amplifier:
    """Outputs that keep their voltages. before: called before each write with the number of writes
    so far; what it raises makes the write fail. there: False makes a reconnection fail."""

    def __init__(self) -> None:
        self.volts: dict[str, float] = {}
        self.written: dict[str, list[float]] = {}
        self.before: Callable[[int], None] = lambda count: None
        self.there, self.made = True, 0

    def make(self) -> "Amplifier":
        if not self.there:
            raise OSError("it is off")
        self.made += 1
        return self

    def write(self, name: str, volts: float) -> None:
        self.before(sum(len(one) for one in self.written.values()))
        self.volts[name] = volts
        self.written.setdefault(name, []).append(volts)

    def output(self, name: str) -> float:
        return self.volts.get(name, 0.0)

    def steps(self, name: str = "x", start_v: float = 0.0) -> Floats:
        """Return the changes of an output at its writes [V]."""
        return np.diff([start_v, *self.written[name]])


@pytest.fixture
def amplifier(monkeypatch: pytest.MonkeyPatch) -> Amplifier:
    made = Amplifier()
    monkeypatch.setitem(sys.modules, "an_amplifier", SimpleNamespace(make=made.make))
    return made


class VirtualTime:
    """The clocks of `acquire`, which advance only by its own sleeps and by `stall`."""

    def __init__(self, monkeypatch: pytest.MonkeyPatch) -> None:
        self.now_ns = 0
        monkeypatch.setattr(clock, "monotonic_ns", lambda: self.now_ns)
        monkeypatch.setattr(clock, "sleep_s", self.stall)
        acquiring = "dehyst.daemon.acquire.one_axis.sleeper"
        monkeypatch.setattr(acquiring, lambda: self.sleep_until)

    def stall(self, seconds: float) -> None:
        self.now_ns += round(seconds * clock.NS)

    def sleep_until(self, due_ns: int) -> int:
        self.now_ns = max(self.now_ns, due_ns)
        return self.now_ns


@pytest.fixture
def time(monkeypatch: pytest.MonkeyPatch) -> VirtualTime:
    return VirtualTime(monkeypatch)


def controller(folder: Path, more: str = KNOWN, axes: str = "") -> Controller:
    text = CONFIG.format(run=folder / "run")
    for axis in axes or [""]:
        head, prefix = (f"[axis.{axis}]", f"axis.{axis}.") if axis else ("", "")
        name = axis or "x"
        given = more.format(name=name)
        text += DEVICES.format(head=head, axis=prefix, name=name, more=given)
    (folder / "stage.toml").write_text(text)
    return load_controller(folder / "stage.toml")


def sine(seconds: float = 2.0) -> tuple[Floats, Floats]:
    t_s = np.arange(0.0, seconds, 1.0 / RATE_HZ)
    return t_s, 50.0 - 50.0 * np.cos(2 * np.pi * t_s)


def fails_at(number: int, amplifier: Amplifier, for_good: bool = False) -> None:
    """Make this write fail as for a late reply, and if `for_good`, all later ones and the
    reconnections."""
    failed: list[int] = []

    def before(count: int) -> None:
        if count >= number and (for_good or not failed):
            failed.append(count)
            amplifier.there = not for_good
            raise TimeoutError("no reply")

    amplifier.before = before


# -- the steps of the writes ----------------------------------------------------------------------


def test_after_a_stall_the_output_catches_up_within_the_slew_limit(
    tmp_path: Path, amplifier: Amplifier, time: VirtualTime
) -> None:
    """A process that was stopped for 0.4 s finds its drive 90 V away."""
    (config,) = controller(tmp_path).axes
    amplifier.before = lambda count: time.stall(0.4) if count == 120 else None
    recording, ended = acquire(config, *sine(), "v", 0.0)
    assert ended == ""
    assert np.abs(amplifier.steps()).max() <= SLEW / RATE_HZ * (1 + 1e-6)
    gap = int(np.argmax(np.diff(recording.t_s)))
    assert np.diff(recording.t_s)[gap] > 0.35
    # the recording has what was written, and the drive again once the output has caught up
    assert set(recording.drive) <= set(amplifier.written["x"])
    t_s, volts = sine()
    meant = np.interp(recording.t_s - 1.0 / RATE_HZ, t_s, volts)
    off = np.abs(recording.drive - meant)
    assert off[gap + 2] > 50.0
    assert off[-50:].max() < 1e-6
    assert amplifier.volts["x"] == 0.0


def slew_limited(kind: str) -> tuple[Floats, Floats]:
    if kind == "designed":
        made = design(0.0, 100.0, (1.0, 4.0), 8.0, RATE_HZ, sines=3, slew_per_s=SLEW, seed=1)
        return made.t_s, made.u
    up = np.arange(0.0, 100.0 + 1e-9, SLEW / RATE_HZ)
    volts = np.concatenate([up, up[-2::-1], up[1:], up[-2::-1]])
    return np.arange(volts.size) / RATE_HZ, volts


@pytest.mark.parametrize("kind", ["designed", "as fast as it may"])
def test_a_drive_within_the_slew_limit_is_written_to_the_bit(
    tmp_path: Path, amplifier: Amplifier, time: VirtualTime, kind: str
) -> None:
    (config,) = controller(tmp_path).axes
    t_s, volts = slew_limited(kind)
    recording, ended = acquire(config, t_s, volts, "v", 0.0)
    assert ended == ""
    meant = np.interp(np.arange(t_s[0], t_s[-1], 1.0 / RATE_HZ), t_s, volts)
    written = np.array(amplifier.written["x"])
    first = round(float(meant[0]) / (RAMP / RATE_HZ) + 0.5)  # writes of the ramp to the drive
    starts = [i for i in range(first + 3) if np.array_equal(written[i : i + meant.size], meant)]
    assert starts
    np.testing.assert_array_equal(recording.drive[1:], meant[:-1])


@pytest.mark.parametrize("exercise_s", [0.0, 1.0])
def test_a_unit_that_cannot_report_is_ramped_from_where_it_was_left(
    tmp_path: Path, amplifier: Amplifier, time: VirtualTime, exercise_s: float
) -> None:
    (config,) = controller(tmp_path, BLIND).axes
    config.directory.mkdir(parents=True, mode=0o700)
    ring = Ring.create(config.directory / "telemetry.ring", TELEMETRY, 64)
    rows = np.zeros(3, TELEMETRY)
    rows["volts"] = 50.0
    ring.push_many(rows)
    ring.close()
    t_s, volts = sine(0.5)
    _, ended = acquire(config, t_s, 10.0 + 0.1 * volts, "v", exercise_s)
    assert ended == ""
    assert np.abs(amplifier.steps(start_v=50.0)).max() <= RAMP / RATE_HZ * (1 + 1e-6)
    assert amplifier.volts["x"] == 50.0


# -- the return -----------------------------------------------------------------------------------


@pytest.mark.parametrize("more", [KNOWN, BLIND], ids=["reports", "blind"])
def test_one_late_reply_ends_the_recording_and_the_output_returns(
    tmp_path: Path, amplifier: Amplifier, more: str
) -> None:
    (config,) = controller(tmp_path, more).axes
    fails_at(100, amplifier)
    recording, ended = acquire(config, *sine(), "v", 0.0)
    assert "no reply" in ended
    assert "could not be returned" not in ended
    assert recording.drive.max() > 80.0
    assert amplifier.volts["x"] == 0.0
    assert np.abs(amplifier.steps()).max() <= SLEW / RATE_HZ


def test_a_late_reply_during_the_return_does_not_end_it(
    tmp_path: Path, amplifier: Amplifier
) -> None:
    (config,) = controller(tmp_path).axes
    fails_at(150, amplifier)
    stopped = lambda: "enough" if len(amplifier.written.get("x", [])) > 100 else ""  # noqa: E731
    _, ended = acquire(config, *sine(), "v", 0.0, stop=stopped)
    assert ended == "enough"
    assert amplifier.made == 2
    assert amplifier.volts["x"] == 0.0


def test_of_several_outputs_all_return(tmp_path: Path, amplifier: Amplifier) -> None:
    axes = controller(tmp_path, axes="xy").axes
    fails_at(150, amplifier)
    t_s, volts = sine(1.0)
    _, ended = play_axes(axes, t_s, np.stack([volts, 0.5 * volts], axis=1), "v", 0.0)
    assert "no reply" in ended
    assert max(amplifier.written["x"]) > 50.0
    assert amplifier.volts == {"x": 0.0, "y": 0.0}


@pytest.mark.parametrize("axes", ["", "xy"])
def test_an_output_that_cannot_be_returned_is_reported(
    tmp_path: Path, amplifier: Amplifier, time: VirtualTime, axes: str
) -> None:
    configs = controller(tmp_path, axes=axes).axes
    fails_at(150, amplifier, for_good=True)
    t_s, volts = sine(1.0)
    _, ended = play_axes(configs, t_s, np.stack([volts] * len(configs), axis=1), "v", 0.0)
    reason, *said = ended.split("; ")
    assert "no reply" in reason
    left = [f" of axis {axis}" for axis in axes] or [""]
    assert said == [
        f"the output{of} could not be returned and stays at about {volts:.1f} V"
        for of, volts in zip(left, amplifier.volts.values(), strict=True)
    ]
    assert max(amplifier.volts.values()) > 50.0
    assert 4.0 < time.now_ns * 1e-9 - 150 / RATE_HZ / len(configs) < 7.0  # it was waited for


# -- one process at a time ------------------------------------------------------------------------


def words(folder: Path, seconds: float = 0.1) -> list[str]:
    write_recording(folder / "drive.csv", sine(seconds)[0], {"u_v": sine(seconds)[1]})
    files = [str(folder / name) for name in ("drive.csv", "stage.toml", "rec.csv")]
    return ["acquire", files[0], "--config", files[1], "-o", files[2], "--exercise", "0"]


@pytest.mark.parametrize("axes", ["", "xy"])
def test_beside_a_daemon_nothing_is_written(
    tmp_path: Path, amplifier: Amplifier, capsys: pytest.CaptureFixture[str], axes: str
) -> None:
    directory, command = controller(tmp_path, axes=axes).directory, words(tmp_path)
    command += ["--axis", "y"] if axes else []
    with run_folder.at_work(directory, run_folder.OUTPUT, "core", tmp_path / "stage.toml"):
        assert main(command) == 2
    said = capsys.readouterr().err
    assert f"{directory} is in use by process {os.getpid()} (dehyst core of " in said
    assert amplifier.made == 0
    assert not amplifier.written
    assert not (tmp_path / "rec.csv").exists()


def test_no_daemon_drives_the_output_beside_it(tmp_path: Path, amplifier: Amplifier) -> None:
    directory, refused = controller(tmp_path).directory, []

    def before(count: int) -> None:
        with (
            suppress(run_folder.InUse),
            run_folder.at_work(directory, run_folder.OUTPUT, "core", tmp_path / "stage.toml"),
        ):
            return
        refused.append(count)

    amplifier.before = before
    assert main(words(tmp_path)) == 0
    assert len(refused) == len(amplifier.written["x"]) > 10


# -- signals --------------------------------------------------------------------------------------


def test_a_hang_up_is_noted_unless_it_was_ignored() -> None:
    before: Any = signal.getsignal(signal.SIGHUP)
    try:
        with signals_noted() as noted:
            assert callable(signal.getsignal(signal.SIGHUP))
            signal.raise_signal(signal.SIGHUP)
        assert noted == [signal.SIGHUP]
        assert signal.getsignal(signal.SIGHUP) is before
        signal.signal(signal.SIGHUP, signal.SIG_IGN)  # as nohup does
        with signals_noted() as noted:
            signal.raise_signal(signal.SIGHUP)
        assert noted == []
    finally:
        signal.signal(signal.SIGHUP, before)
