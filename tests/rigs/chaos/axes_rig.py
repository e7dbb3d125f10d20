"""The rig of the chaos tests with three axes on one amplifier.

The faults of one axis are applied to x, as in the rig of one axis; y plays a trajectory of its own
at the same time; z rests in its safe state and nobody commands it. The amplifier's log shows for
each channel whether it stayed within range and slew, and that z never moved.
"""

import subprocess
import sys
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
from tests.rigs.chaos import commands, faults
from tests.rigs.chaos.rig import (
    HOLD_S,
    LIMITS,
    MAX_V,
    RAMP,
    RATE_HZ,
    ROOT,
    SAFE_V,
    SLEW,
    Listener,
    Rig,
    StoodStill,
    samples_since,
    until,
)
from tests.rigs.output import check_range, check_speed, during
from tests.rigs.processes import PATIENT

from dehyst.daemon.rings.records import Flag, State

AXES, RESTING, REST_V = "xyz", "z", 30.0
MOST_UM_PER_S = 20.0  # of the trajectory's target: 17.3, rounded up
CALM_NS = 3_000_000_000  # a client that has to start again has done so by then
MOST_SILENT_S = 0.5  # between two moves of an undisturbed channel, on a busy machine
UNDISTURBED: tuple[Callable[..., str], ...] = (
    faults.kill_client,
    faults.stop_client,
    faults.sensor_stuck,
    faults.sensor_invalid,
    faults.sensor_range,
    faults.sensor_unplug,
    faults.disk_full,
    faults.file_limit,
    faults.clock_stepped,
    commands.two_clients,
    commands.bad_setpoints,
    commands.long_message,
    commands.flood,
    commands.stranger_floods,
)
"""Faults of x alone: y plays on without a gap."""

CONFIG = """
name = "chaos"
run_dir = "{run}"
loop = {{rate_hz = {rate}}}
actuator = {{driver = "mdt693b", settings = {{port = "{mdt693b}", {patient}}}}}
"""
CONFIG += LIMITS
AXIS = """
[axis.{axis}]
model = {{file = "{model}"}}
actuator.settings.axis = "{axis}"
sensor = {{driver = "ksg101", settings = {{port = "{port}", {patient}}}}}
"""


class AxesRig(Rig):
    """The complete running rig with three axes. What Rig says of the output applies to x."""

    name = "chaos-x"
    commanded = ("chaos-x", "chaos-y")
    axes = AXES
    bench_options = ("--axes", "3")

    def __init__(self, folder: Path, models: dict[str, Path], on_fault: str = "ramp") -> None:
        self.models = {axis: path.read_text() for axis, path in models.items()}
        self.others: dict[str, Listener] = {}
        self.beside: subprocess.Popen[bytes] | None = None
        self.rested_ns = 0
        super().__init__(folder, models["x"], on_fault)

    def configured(self, on_fault: str) -> str:
        text = CONFIG.format(
            run=self.folder / "run", rate=RATE_HZ, max_v=MAX_V, slew=SLEW, safe_v=SAFE_V, ramp=RAMP,
            hold_s=HOLD_S, on_fault=on_fault, listen=self.address, mdt693b=self.ports["mdt693b"],
            patient=PATIENT,
        )  # fmt: skip
        for axis in AXES:
            path = self.model if axis == "x" else self.folder / f"model-{axis}.toml"
            path.write_text(self.models[axis])
            port = self.ports[f"ksg101-{axis}"]
            text += AXIS.format(axis=axis, model=path, port=port, patient=PATIENT)
        return text + f"safe.voltage_v = {REST_V}\n"

    @property
    def kept(self) -> Path:
        return self.folder / "run" / "x" / "mismatch"

    def run(self) -> None:
        """Start as Rig does: x and y play, z has been brought to its place."""
        super().run()
        for axis in "yz":
            client = until(lambda a=axis: self._connect(f"chaos-{a}"), 30.0, f"axis {axis}")
            self.others[axis] = Listener(client)
            self.others[axis].start()
        self.others[RESTING].client.release()
        until(lambda: abs(self.volts(RESTING) - REST_V) < 0.01, 30.0, "z stands")
        self.rested_ns = time.monotonic_ns()
        self.start_beside()
        self.until_running(60.0)

    def start_beside(self) -> None:
        """Start the client that commands y."""
        script = str(ROOT / "tests" / "rigs" / "chaos" / "mover.py")
        command = [sys.executable, script, self.address, "chaos-y", str(self.lasts_s)]
        self.beside = self._start(command, "beside")

    def end_beside(self) -> None:
        """Kill the client that commands y."""
        assert self.beside is not None
        self.beside.kill()
        self.beside.wait(5.0)
        self.beside = None

    def volts(self, axis: str) -> float:
        """Return the present voltage at an output."""
        return float(self.bench_order()["axes"][axis]["output_v"])

    def record(self, path: Path, *arguments: str, name: str = "record") -> Any:
        """Record x."""
        return super().record(path, "--name", self.name, *arguments, name=name)

    def until_running(self, seconds: float = 30.0) -> None:
        """Wait until both trajectories run."""
        super().until_running(seconds)
        if self.beside is not None:
            until(lambda: self._plays("y"), seconds, f"y plays too\n{self.words('run')[-2000:]}")

    def mark(self) -> None:
        """Set the mark, after the clients have seen all earlier events and have started again."""
        for axis in "xy":
            until(lambda a=axis: self._plays(a, CALM_NS), 60.0, f"{axis} plays as ever")
        super().mark()

    def _plays(self, axis: str, calm_ns: int = 0) -> bool:
        """Return whether an axis follows its trajectory, and has done so for calm_ns."""
        now_ns = time.monotonic_ns()
        samples = samples_since(now_ns - 1_000_000_000 - calm_ns, self.heard(axis))
        if not samples.size:
            return False
        samples = samples[samples["scheduled_ns"] >= samples["scheduled_ns"][-1] - calm_ns]
        way_there = samples["flags"] & Flag.APPROACH
        return bool(np.all(samples["state"] == State.RUNNING) and not np.any(way_there))

    # -- what the log of each channel shows -----------------------------------------------------

    def channel(self, axis: str) -> tuple[np.ndarray, np.ndarray]:
        """Return (time_ns, volts) of a channel since the rig began, from the amplifier's log."""
        self.bench_order(save=True)
        head = "" if axis == AXES[0] else f"{axis}_"
        with np.load(self.log) as data:
            return data[f"{head}time_ns"], data[f"{head}volts"]

    def heard(self, axis: str) -> list[np.ndarray]:
        """Return the batches of telemetry of an axis."""
        listener = self.listener if axis == "x" else self.others[axis]
        assert listener is not None
        return listener.samples

    def samples_of(self, axis: str) -> np.ndarray:
        """Return the telemetry of an axis since the mark."""
        return samples_since(self.fault_ns, self.heard(axis))

    def check_rested(self) -> None:
        """Check that z, which nobody commands, has not moved since it was brought to its place."""
        time_ns, volts = self.channel(RESTING)
        moved = np.flatnonzero(time_ns > self.rested_ns)
        assert moved.size == 0, (
            f"z moved, which nobody commanded: to {volts[moved[0]]:.3f} V "
            f"{(time_ns[moved[0]] - self.fault_ns) * 1e-9:.3f} s after the mark"
        )

    def check_channel(self, axis: str) -> None:
        """Check range and slew since the mark."""
        time_ns, volts = during(*self.channel(axis), self.fault_ns)
        check_range(volts, 0.0, MAX_V)
        check_speed(time_ns, volts, SLEW, SLEW / RATE_HZ)

    def check_undisturbed(self, axis: str, since_ns: int = 0) -> None:
        """Check that an axis was undisturbed since the mark, or since_ns if that is later: no
        sample is missing, every one is in its trajectory, the target follows the trajectory, and
        the output never stops moving. Raises StoodStill if one of the last two is not so, but the
        loop stood still: it then glides, which is flagged as an approach."""
        since_ns = max(since_ns, self.fault_ns)
        samples = samples_since(since_ns, self.heard(axis))
        assert samples.size, f"no telemetry of {axis}"
        assert set(np.diff(samples["seq"])) <= {1}, f"telemetry of {axis} has a gap"
        states = {State(int(s)).name for s in np.unique(samples["state"])}
        assert states == {"RUNNING"}, f"{axis} was disturbed: {states}"
        anew = bool(np.bitwise_or.reduce(samples["flags"]) & Flag.APPROACH)
        way = np.abs(np.diff(samples["target"]))  # by the clock, in case a deadline was missed
        most = MOST_UM_PER_S * np.diff(samples["scheduled_ns"]) * 1e-9
        assert np.all(way <= most), f"the target of {axis} jumped by {np.nanmax(way):.3f} um"
        time_ns, _ = during(*self.channel(axis), since_ns)
        silent_s = float(np.max(np.diff(time_ns))) * 1e-9
        if anew or silent_s >= MOST_SILENT_S:
            self.check_never_still(samples)
        assert not anew, f"{axis} began anew"
        assert silent_s < MOST_SILENT_S, f"the output of {axis} stood still for {silent_s:.2f} s"

    def check_never_still(self, samples: np.ndarray) -> None:
        """Raise StoodStill if the loop stood still between two of these samples."""
        longest_ns = np.diff(samples["actual_ns"]).max(initial=0)
        if longest_ns > commands.STOOD_STILL_NS:
            raise StoodStill(f"not judged: the loop stood still for {longest_ns * 1e-9:.2f} s")

    def judge(self, fault: Callable[..., str]) -> None:
        """Check that z has not moved, and that y kept to its limits and, for faults of x alone,
        played on."""
        self.check_rested()
        self.check_channel("y")
        if fault in UNDISTURBED:
            self.check_undisturbed("y")

    def close(self) -> None:
        for listener in self.others.values():
            listener.ending.set()
            listener.join(5.0)
        super().close()
        for listener in self.others.values():
            listener.client.close()
