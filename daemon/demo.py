"""The story that `dehyst demo` tells: a user's own steps, with the user's own commands."""

import os
import signal
import socket
import subprocess
import time
from collections.abc import Callable
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from dehyst.daemon.acquire import acquire
from dehyst.daemon.benchconfig import FULL_SCALE_V, RATE_HZ, exploring_drive, write_bench
from dehyst.daemon.client import Client
from dehyst.daemon.config import load_config
from dehyst.daemon.files import load_model, save_model
from dehyst.daemon.recordings import read_recording, write_recording
from dehyst.daemon.supervisor import DEHYST, Bench
from dehyst.models.errors import DehystError
from dehyst.models.model import Hysteresis, Model, Validity
from dehyst.models.recording import Recording

CYCLES = 6
STROKE_SHARE = 0.94  # of the reachable range; the rest is margin at both ends
START_S = 240.0  # with a cold cache the kernels are compiled first


def free_port() -> int:
    """A TCP port on the loopback that nobody listens on."""
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        return int(probe.getsockname()[1])


class Demo:
    """One run. folder: scratch; output: what the user keeps."""

    def __init__(self, folder: Path, output: Path, say: Callable[[str], None]) -> None:
        self.folder, self.output, self.say = folder, output, say
        self.endpoint = f"tcp/127.0.0.1:{free_port()}"
        self.rate_hz = RATE_HZ
        self.stroke_um = 0.0
        self.tracks: dict[str, Recording] = {}
        self._children: list[subprocess.Popen[bytes]] = []
        say("1. an emulated MDT693B and KSG101, with a simulated stage behind")
        self._bench = Bench(folder, [])
        self._config = write_bench(folder, self._bench.ports, "demo", self.endpoint, None)

    def excite_and_record(self, progress: Callable[[float], None]) -> None:
        """Drive the stage open loop through the serial drivers."""
        t_s, volts = exploring_drive()
        self.say(f"2. exercise it, drive it open loop for {t_s[-1]:.0f} s over serial, and record")
        recording = acquire(load_config(self._config), t_s, volts, "v", progress=progress)
        assert recording.displacement is not None
        write_recording(
            self.output / "recording.csv",
            recording.t_s,
            {"u_v": recording.drive, "y_um": recording.displacement},
            {"source": "dehyst demo, simulated stage"},
        )

    def identify(self) -> None:
        """`dehyst identify`, and a straight line through the same recording."""
        self.say("3. identify a model from that recording")
        path = self.output / "recording.csv"
        self._dehyst("identify", str(path), "-o", str(self.output / "model.toml"))
        recording = read_recording(path)
        assert recording.displacement is not None
        good = ~(recording.missing_drive | recording.missing_displacement)
        gain, offset = np.polyfit(recording.drive[good], recording.displacement[good], 1)
        self._linear = Model(
            Hysteresis(r=np.zeros(1), b=np.ones(1), c=np.array([offset, gain])),
            Validity(0.0, FULL_SCALE_V),
        )

    def track(self) -> dict[str, float]:
        """Run the daemon, play a sine with each model; rms tracking errors by name [um]."""
        model = load_model(self.output / "model.toml")
        from dehyst.daemon.checks import drive_range, reach

        save_model(self._linear, self.folder / "model.toml")
        low, high = reach(model, *drive_range(load_config(self._config), model))
        middle, half = 0.5 * (low + high), 0.5 * (high - low) * STROKE_SHARE
        self.stroke_um = 2 * half
        t_s = np.arange(round(CYCLES * self.rate_hz) + 1) / self.rate_hz
        trajectory = self.output / "trajectory.csv"
        write_recording(trajectory, t_s, {"target_um": middle - half * np.cos(2 * np.pi * t_s)}, {})
        self.say("4. run the daemon with a linear gain; a client streams a 1 Hz sine to it")
        core = self._start("core", "--config", str(self._config))
        self._start("gateway", "--config", str(self._config))
        self._ready()
        results = {"linear gain": self._play("linear", trajectory)}
        self.say("5. give it the identified model (SIGHUP), and play the same again")
        save_model(model, self.folder / "model.toml")
        core.send_signal(signal.SIGHUP)
        time.sleep(1.0)
        results["compensated"] = self._play("compensated", trajectory)
        return results

    def _ready(self) -> None:
        """Wait until the daemon answers and its loop runs."""
        end_s = time.monotonic() + START_S
        while time.monotonic() < end_s:
            try:
                with Client(connect=self.endpoint) as client:
                    while not client.status().core_alive and time.monotonic() < end_s:
                        time.sleep(0.2)
                    return
            except DehystError:
                time.sleep(0.2)
        raise DehystError(f"the daemon did not start within {START_S:g} s")

    def _play(self, name: str, trajectory: Path) -> float:
        """Stream the trajectory from a separate process while another records; rms error [um]."""
        path = self.output / f"track-{name}.csv"
        recorder = self._start("record", "--connect", self.endpoint, "-o", str(path))
        self._dehyst("play", str(trajectory), "--connect", self.endpoint, "--allow-unreachable")
        recorder.send_signal(signal.SIGINT)
        recorder.wait(20.0)
        recording = read_recording(path)
        self.tracks[name] = recording
        target = recording.channels["target_um"]
        return rms_error(recording, sine_part(recording.t_s, target))

    def _start(self, *arguments: str) -> subprocess.Popen[bytes]:
        child = subprocess.Popen(
            [*DEHYST, *arguments],
            stdin=subprocess.DEVNULL,
            stdout=subprocess.DEVNULL,
            env={**os.environ, "DEHYST_SUPERVISED": "1"},
        )
        self._children.append(child)
        return child

    def _dehyst(self, *arguments: str) -> None:
        done = subprocess.run(
            [*DEHYST, *arguments],
            stdin=subprocess.DEVNULL,
            stdout=subprocess.DEVNULL,
            check=False,
            timeout=120.0,
        )
        if done.returncode not in (0, 1):
            raise DehystError(f"`dehyst {arguments[0]}` ended with code {done.returncode}")

    def close(self) -> None:
        """End everything that was started, the bench last."""
        for child in reversed(self._children):
            if child.poll() is None:
                child.terminate()
        for child in self._children:
            try:
                child.wait(30.0)
            except subprocess.TimeoutExpired:
                child.kill()
                child.wait(5.0)
        self._bench.close()


def sine_part(t_s: NDArray[np.float64], target: NDArray[np.float64]) -> NDArray[np.bool_]:
    """Samples of the sine after its first period: without approach, and without the end's hold."""
    moving = np.abs(np.gradient(np.nan_to_num(target), t_s)) > 1e-9
    if not moving.any():
        raise DehystError("the daemon did not follow the trajectory")
    last = float(t_s[np.flatnonzero(moving)[-1]])
    return (t_s > last - (CYCLES - 1.0)) & (t_s < last)


def rms_error(recording: Recording, part: NDArray[np.bool_]) -> float:
    """rms of measured minus target over a part [um]."""
    assert recording.displacement is not None
    error = (recording.displacement - recording.channels["target_um"])[part]
    return float(np.sqrt(np.nanmean(error**2)))


def draw(demo: Demo, path: Path) -> None:
    """Target, measured and error over one second, and the loop target to measured."""
    from dehyst.daemon.plotting import figure, save

    fig, axes = figure(1, 3, (12.5, 3.8), widths=(1.5, 1.5, 1.0))
    colours = {"linear": "#c8553d", "compensated": "#2a6f97"}
    labels = {"linear": "linear gain", "compensated": "compensated"}
    for name, recording in demo.tracks.items():
        target, measured = recording.channels["target_um"], recording.displacement
        assert measured is not None
        part = sine_part(recording.t_s, target)
        t_s = recording.t_s[part] - recording.t_s[part][0]
        if name == "linear":
            axes[0].plot(t_s, target[part], color="#999999", lw=4, label="set-point")
        axes[0].plot(t_s, measured[part], color=colours[name], lw=1.2, label=labels[name])
        error = 1e3 * (measured - target)[part]
        rms = np.sqrt(np.nanmean(error**2))
        axes[1].plot(
            t_s, error, color=colours[name], lw=1, label=f"{labels[name]}: {rms:.0f} nm rms"
        )
        axes[2].plot(target[part], measured[part], color=colours[name], lw=1)
    for axis, x, y, title in zip(
        axes,
        ("time, s", "time, s", "set-point, um"),
        ("displacement, um", "error, nm", "measured, um"),
        ("1 Hz sine over the full stroke", "tracking error", "where it should be, where it is"),
        strict=True,
    ):
        axis.set(xlabel=x, ylabel=y, title=title)
    axes[0].set_xlim(0, 2)
    axes[0].legend(loc="lower right", fontsize=8)
    axes[1].legend(loc="upper right", fontsize=8)
    save(fig, path)
