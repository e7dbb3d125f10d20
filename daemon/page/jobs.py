"""Run long tasks and tasks that read untrusted files, each in a separate, limited process.

One check of a trajectory and one long task may run at a time, so that neither waits for the other.
The child has the lowest priority, limited memory and time and no access to the bus, and ends with
the server. It answers in JSON; its output files are in a folder that is deleted with the job.
"""

import multiprocessing
import re
import secrets
import shutil
import tempfile
import threading
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from multiprocessing.connection import Connection
from pathlib import Path
from typing import Any, Literal

import msgspec
import numpy as np
from numpy.typing import NDArray

from dehyst.daemon import clock
from dehyst.daemon.service.bounded import take_bounds
from dehyst.models.errors import BadInput, DehystError, NotNow
from dehyst.models.recording import Recording, Trajectory
from dehyst.models.units import spell_unit

Kind = Literal["trajectory", "identify", "diagnose"]
KINDS = ("trajectory", "identify", "diagnose")
LANES: tuple[tuple[Kind, ...], ...] = (("trajectory",), ("identify", "diagnose"))
LARGEST_BYTES = 64 << 20  # of a dropped file
MEMORY_BYTES = 6 << 30  # of a job, below MemoryMax=7G of the unit: the job ends, not the page
TIME_S = {"trajectory": 120.0, "identify": 600.0, "diagnose": 1800.0}
KEPT, WAITING = 12, 4  # newest results that are kept, and files that wait: bounds disk and memory
PREVIEWED = 2000  # points of a curve, about one per pixel of a wide screen
MOST_POINTS = 2_000_000  # of a trajectory: 33 minutes at 1 kHz


class Setting(msgspec.Struct, frozen=True):
    """The controller's settings that a preview needs. low, high: range of the drive; slew: of the
    drive, per second; origin: model displacement at set-point 0; reach: range of set-points."""

    model: str
    unit: str
    origin: float
    reach: tuple[float, float]
    low: float
    high: float
    slew: float
    mode: str
    preview_s: float
    period_s: float


@dataclass
class Job:
    """settings: of the controller's axes by name, and of the shown axis as ""; state: waiting,
    working, done or failed; text: the present step, or the error."""

    number: str
    kind: Kind
    file: str
    folder: Path
    settings: Mapping[str, Setting]
    controller: str = ""
    """The controller that was shown when the file was uploaded; the result is valid for it."""
    state: str = "waiting"
    text: str = "waiting for the previous file"
    share: float = 0.0
    result: dict[str, Any] = field(default_factory=dict)

    def describe(self) -> dict[str, Any]:
        """Return the job's description for the browser."""
        names = ("number", "kind", "file", "controller", "state", "text", "share", "result")
        said = {name: getattr(self, name) for name in names}
        said["report"] = self.state == "done" and (self.folder / "report.html").exists()
        said["model"] = self.state == "done" and (self.folder / "model.toml").exists()
        return said

    def trajectory(self) -> tuple[NDArray[np.float64], dict[str, NDArray[np.float64]]]:
        """Return t_s and the targets by axis ("": the only one) of a checked trajectory. Raises
        BadInput if the job is not one."""
        if self.kind != "trajectory" or self.state != "done":
            raise BadInput(f"{self.file}: is not a trajectory that was checked")
        rows = np.load(self.folder / "trajectory.npy", allow_pickle=False)
        axes = self.result.get("axes") or {"": None}
        return rows[0], dict(zip(axes, rows[1:], strict=True))


class Jobs:
    """The newest KEPT jobs. One thread per lane runs them in order."""

    def __init__(self) -> None:
        self._folder = tempfile.TemporaryDirectory(prefix="dehyst-page-")
        self._jobs: dict[str, Job] = {}
        self._wake = threading.Condition()
        self._ended = False
        self._children: set[Any] = set()
        self._threads = [
            threading.Thread(target=self._run, args=(lane,), name="jobs", daemon=True)
            for lane in LANES
        ]
        for thread in self._threads:
            thread.start()

    def close(self) -> None:
        """Stop the running jobs and delete all files."""
        with self._wake:
            self._ended = True
            self._wake.notify_all()
        for child in list(self._children):
            child.kill()
        for thread in self._threads:
            thread.join(5.0)
        self._folder.cleanup()

    def add(
        self,
        kind: Kind,
        file: str,
        data: bytes,
        settings: Mapping[str, Setting],
        controller: str = "",
    ) -> Job:
        """Add a job. Raises NotNow if too many are waiting."""
        with self._wake:
            if sum(j.state == "waiting" for j in self._jobs.values()) >= WAITING:
                raise NotNow("too many files are waiting; try again when they are done")
            while len(self._jobs) >= KEPT:
                old = next(n for n, j in self._jobs.items() if j.state in ("done", "failed"))
                shutil.rmtree(self._jobs.pop(old).folder, ignore_errors=True)
        number = secrets.token_hex(8)
        folder = Path(self._folder.name) / number
        folder.mkdir()
        name = re.sub(r"[^A-Za-z0-9._-]", "_", Path(file).name)[-80:].lstrip(".") or "file"
        (folder / name).write_bytes(data)
        job = Job(number, kind, name, folder, settings, controller)
        with self._wake:
            self._jobs[number] = job
            self._wake.notify_all()
        return job

    def get(self, number: str) -> Job | None:
        """Return a job, or None if it is no longer kept."""
        return self._jobs.get(number)

    def _run(self, lane: tuple[Kind, ...]) -> None:
        while True:
            with self._wake:
                self._wake.wait_for(lambda: self._ended or self._next(lane) is not None)
                job = self._next(lane)
                if self._ended or job is None:
                    return
                job.state, job.text = "working", "begins"
            try:
                self._work(job)
            except DehystError as error:
                job.text, job.state = str(error), "failed"
            except Exception as error:  # any failure of the child
                job.text, job.state = f"not possible: {error!r}"[:300], "failed"

    def _next(self, lane: tuple[Kind, ...]) -> Job | None:
        waiting = (j for j in self._jobs.values() if j.state == "waiting" and j.kind in lane)
        return next(waiting, None)

    def _work(self, job: Job) -> None:
        ours, theirs = multiprocessing.Pipe(duplex=False)
        spawn = multiprocessing.get_context("spawn")
        child = spawn.Process(
            target=work, args=(job.kind, str(job.folder), job.file, job.settings, theirs)
        )
        end_ns = clock.monotonic_ns() + round(TIME_S[job.kind] * clock.NS)
        child.start()
        self._children.add(child)
        theirs.close()
        try:
            while job.state == "working":
                left_s = (end_ns - clock.monotonic_ns()) / clock.NS
                if left_s <= 0 or not ours.poll(left_s):
                    raise NotNow(f"{job.file}: not done within {TIME_S[job.kind]:g} s")
                job_hears(job, ours)
        finally:
            child.kill()
            child.join(5.0)
            self._children.discard(child)
            ours.close()


def job_hears(job: Job, pipe: Connection) -> None:
    """Receive one message of the child and update the job. Raises NotNow if the child has ended."""
    try:
        said = msgspec.json.decode(pipe.recv_bytes(32 << 20))
    except EOFError:
        raise NotNow(
            f"{job.file}: the process ended; it may take at most {MEMORY_BYTES >> 30} GB"
        ) from None
    job.text, job.share = said["text"], said["share"]
    job.result = said["result"]
    job.state = said["state"]


# -- in the child ---------------------------------------------------------------------------------


def work(
    kind: Kind, folder: str, file: str, settings: Mapping[str, Setting], pipe: Connection
) -> None:
    """Run one job; this is the child's main function."""
    take_bounds(MEMORY_BYTES)

    def say(text: str, share: float = 0.0, state: str = "working", **result: Any) -> None:
        message = {"text": text, "share": share, "state": state, "result": result}
        pipe.send_bytes(msgspec.json.encode(message))

    tasks: dict[str, Callable[..., dict[str, Any]]] = {
        "trajectory": look_at_trajectory,
        "identify": identify_file,
        "diagnose": diagnose_file,
    }
    try:
        say("reading")
        result = tasks[kind](Path(folder), Path(folder) / file, settings, say)
        say("done", 1.0, "done", **result)
    except DehystError as error:
        say(say_refusal(error).replace(f"{folder}/", ""), state="failed")
    except MemoryError:
        say(f"{file}: takes more than {MEMORY_BYTES >> 30} GB", state="failed")


def with_reading(said: str, recordings: Sequence[Recording]) -> str:
    """Return the result, preceded by how the file of another program was interpreted."""
    return "\n".join([*filter(None, [recordings[0].read]), said])


def say_refusal(error: DehystError) -> str:
    """Return the text of an error. If it asks for command-line options, which the page does not
    have, it adds how to convert the file."""
    text = str(error)
    asks = any(option in text for option in ("--columns", "--rate", "--unit", "--time-unit"))
    more = "; dehyst convert with these options writes a file that needs none" if asks else ""
    return text + (more if "dehyst convert" not in text else "")


def identify_file(folder: Path, path: Path, _: Mapping[str, Setting], say: Any) -> dict[str, Any]:
    """Run `dehyst identify` on one recording."""
    from dehyst.daemon.api.functions import identify

    found = identify(path, progress=say)
    found.save(folder / "model.toml")
    say("writing the report", 0.95)
    found.report(folder / "report.html", "model.toml")
    return {"said": with_reading(str(found), found.recordings)}


def diagnose_file(
    folder: Path, path: Path, settings: Mapping[str, Setting], say: Any
) -> dict[str, Any]:
    """Run `dehyst diagnose` on one recording, relative to the model in use if there is one."""
    from dehyst.daemon.api.functions import diagnose
    from dehyst.models.modelfile import loads

    model = loads(settings[""].model) if "" in settings else None
    found = diagnose(path, model=model, progress=say)
    found.save(folder)
    return {"said": with_reading(str(found), found.recordings)}


def look_at_trajectory(
    folder: Path, path: Path, settings: Mapping[str, Setting], say: Any
) -> dict[str, Any]:
    """Check reach and slew rate of a trajectory before it is played, for each axis that it has
    columns for. Raises BadInput."""
    from dehyst.daemon.files.trajectories import read_trajectories

    ways = read_trajectories(path, min_rows=2)
    if strange := [axis for axis in ways if axis not in settings]:
        there = ", ".join(axis for axis in settings if axis) or "one axis: give it target_um"
        raise BadInput(f"{path.name}: has targets for {', '.join(strange)}; there is {there}")
    for axis, way in ways.items():
        if way.unit != (unit := settings[axis].unit):
            raise BadInput(f"{path.name}: is in {way.unit}, the controller takes {unit}")
    t_s = next(iter(ways.values())).t_s
    if t_s.size > MOST_POINTS:
        raise BadInput(f"{path.name}: {t_s.size} points; at most {MOST_POINTS} are checked")
    np.save(folder / "trajectory.npy", np.stack([t_s, *(way.target for way in ways.values())]))
    found = {}
    for number, axis in enumerate(ways):
        of_axis = f" of {axis}" if axis else ""
        say(f"computing the drive{of_axis}", 0.3 + 0.6 * number / len(ways))
        found[axis] = look_at_axis(axis, ways, settings)
    places = np.unique(np.linspace(0, t_s.size - 1, PREVIEWED).astype(int))
    whole = {
        "t_s": (t_s[places] - t_s[0]).tolist(),
        "points": int(t_s.size),
        "duration_s": float(t_s[-1] - t_s[0]),
        "outside": max(one["outside"] for one in found.values()),
    }
    for axis, one in found.items():
        one["target"] = ways[axis].target[places].tolist()
    return whole | found.get("", {"axes": found})


def look_at_axis(
    axis: str, ways: Mapping[str, Trajectory], settings: Mapping[str, Setting]
) -> dict[str, Any]:
    """Compute the drive of one axis while the others follow their targets, and compare it with the
    axis' limits."""
    from dehyst.daemon.api.functions import invert
    from dehyst.daemon.files.axis_columns import axis_column
    from dehyst.models.modelfile import loads

    way, setting = ways[axis], settings[axis]
    low, high = setting.reach
    columns = {
        "t_s": way.t_s - way.t_s[0],
        f"target_{setting.unit}": np.clip(way.target, low, high) + setting.origin,
    }
    for name, other in settings.items():
        if name not in ("", axis):  # an axis without targets is assumed at the middle of its reach
            still = np.full(way.t_s.size, np.mean(other.reach))
            there = ways[name].target if name in ways else still
            columns[axis_column(name, other.unit)] = there + other.origin
    drive = invert(
        loads(setting.model),
        columns,
        preview=setting.preview_s,
        mode=setting.mode,
        low=setting.low,
        high=setting.high,
        period=setting.period_s,
    )
    rate = np.abs(np.diff(drive.drive)) / setting.period_s
    shown = np.unique(np.linspace(0, drive.t_s.size - 1, PREVIEWED).astype(int))
    outside = (way.target < low) | (way.target > high)
    return {
        "drive_t_s": drive.t_s[shown].tolist(),
        "drive": drive.drive[shown].tolist(),
        "least": float(way.target.min()),
        "most": float(way.target.max()),
        "reach": [low, high],
        "outside": float(np.mean(outside)),
        "fastest": float(rate.max()) if rate.size else 0.0,
        "slew": setting.slew,
        "too_fast": float(np.mean(rate > setting.slew * (1 + 1e-9))) if rate.size else 0.0,
        "drive_unit": spell_unit(drive.model.drive_unit),
    }
