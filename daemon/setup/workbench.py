"""What every step of a set-up works with: its folder, its files, and playing a drive."""

import signal
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from dehyst.daemon.acquire.axes import play_axes
from dehyst.daemon.acquire.one_axis import acquire
from dehyst.daemon.config import Config, load_config, load_controller
from dehyst.daemon.config.sections import usable_name
from dehyst.daemon.files.axis_columns import to_columns
from dehyst.daemon.files.known_units import ACTUATOR, open_known
from dehyst.daemon.files.outputs import file_of_axis
from dehyst.daemon.files.recordings import read_recording, write_recording
from dehyst.daemon.setup.journal import Journal
from dehyst.daemon.setup.questions import UserPrompts, Wishes
from dehyst.daemon.terminal.progress import progress_bar
from dehyst.drivers.interface import DeviceSpec
from dehyst.drivers.registry import load_actuator
from dehyst.models.errors import NotNow
from dehyst.models.recording import Floats, Recording

CONFIG, MODEL = "stage.toml", "stage.model.toml"
NAME = "stage-1"
MADE = "# Written by `dehyst setup`, which replaces it if its limits, units or rate change.\n"


class Workbench:
    """One set-up. folder: where everything goes; say: one line for the user."""

    def __init__(
        self,
        folder: Path,
        wishes: Wishes,
        journal: Journal,
        ask: UserPrompts,
        say: Callable[[str], None],
    ) -> None:
        self.folder, self.wishes, self.journal = folder, wishes, journal
        self.ask, self.say = ask, say

    @property
    def name(self) -> str:
        """The controller's: as wished, else the folder's where it can be one. So two stages of one
        machine have two names, and each a run folder of its own."""
        return self.wishes.name or usable_name(self.folder.resolve().name) or NAME

    @property
    def config_path(self) -> Path:
        """The configuration that is used from its step on, by whomever it was written."""
        return self.folder / CONFIG

    @property
    def model_path(self) -> Path:
        """The identified model."""
        return self.folder / MODEL

    def model_path_of(self, axis: str) -> Path:
        """The identified model of one of several axes."""
        return self.in_folder(MODEL, axis)

    def in_folder(self, name: str, axis: str) -> Path:
        """The file of one of several axes by this name."""
        return file_of_axis(self.folder / name, axis)

    @property
    def axes(self) -> tuple[str, ...]:
        """The names of the axes where there are several; none: there is one, without a name."""
        if self.has_own_config():
            names = load_controller(self.config_path).axis_names
            return names if len(names) > 1 else ()
        if self.wishes.axes or self.wishes.axis or not self.journal.done("units"):
            return self.wishes.axes
        return tuple(self.journal.result("units").get("axes", ()))

    def config(self) -> Config:
        """As it stands in the file now."""
        return load_config(self.config_path)

    def configs(self) -> dict[str, Config]:
        """Of each of several axes, by its name."""
        return {config.axis: config for config in load_controller(self.config_path).axes}

    def has_own_config(self) -> bool:
        """Is the configuration one that the user wrote?"""
        return self.config_path.exists() and not self.config_path.read_text("utf-8").startswith(
            MADE
        )

    def put_aside(self, path: Path, text: str) -> Path | None:
        """Rename a file that is to be replaced by another text, so that nothing of the user's is
        lost; its new path, None: it was not there, or says the same."""
        if not path.exists() or path.read_text("utf-8") == text:
            return None
        aside = self._free(path.stem, path.suffix)
        return path.rename(aside)

    def _free(self, stem: str, suffix: str) -> Path:
        names = (self.folder / f"{stem}-{i}{suffix}" for i in range(1, 10_000))
        return next(path for path in names if not path.exists())

    def recording(self, step: str, axis: str = "") -> Recording:
        """What a step recorded, of several axes that of this one."""
        result = self.journal.result(step)
        kept = result["axes"][axis] if axis else result
        return read_recording(self.folder / str(kept["recording"]), need_displacement=True)

    def output_now(self, config: Config) -> tuple[float, DeviceSpec]:
        """Where the output stands as far as the unit tells, and what it can do. Moves nothing."""
        actuator = load_actuator(config.actuator.driver).from_settings(config.actuator.settings)
        try:
            open_known(config, ACTUATOR, actuator)
            return float(actuator.output()), actuator.spec
        finally:
            actuator.close()

    def play(self, t_s: Floats, volts: Floats, exercise_s: float, text: str) -> Recording:
        """Play voltages open loop behind exercise_s of full loops, and record; the output ends
        where it was. Raises NotNow where that ended early, with what was recorded in a file."""
        config = self.config()
        drive = volts / config.actuator.gain
        with interruptible() as stop, progress_bar(text) as progress:
            found, ended = acquire(config, t_s, drive, "v", exercise_s, progress, stop)
        if ended:
            path = self.keep(found, "unfinished")
            raise NotNow(
                f"{ended}; what was recorded before is in {path}. The same command repeats it"
            )
        return found

    def play_axes(
        self, t_s: Floats, volts_at: Floats, exercise_s: float, text: str
    ) -> dict[str, Recording]:
        """As `play`, of volts (N, axes) at the loop's rate: the recording of each axis."""
        configs = list(self.configs().values())
        with interruptible() as stop, progress_bar(text) as progress:
            found, ended = play_axes(configs, t_s, volts_at, "v", exercise_s, progress, stop)
        if ended:
            paths = self.keep_axes(found, "unfinished").values()
            raise NotNow(
                f"{ended}; what was recorded before is in {', '.join(map(str, paths))}. The same "
                "command repeats it"
            )
        return found

    def keep_axes(self, recordings: Mapping[str, Recording], stem: str) -> dict[str, Path]:
        """As `keep`, of each axis."""
        return {axis: self.keep(one, f"{stem}-{axis}") for axis, one in recordings.items()}

    def keep(self, recording: Recording, stem: str) -> Path:
        """Write a recording under a name that is not taken; the path."""
        path = self._free(stem, ".csv")
        assert recording.displacement is not None
        columns = {
            recording.drive_column: recording.drive,
            recording.displacement_column: recording.displacement,
        }
        columns |= to_columns(recording.channels, recording.displacement_unit, recording.drive_unit)
        write_recording(path, recording.t_s, columns, {"source": "dehyst setup"})
        return path


@contextmanager
def interruptible() -> Iterator[Callable[[], str]]:
    """Ctrl-C and SIGTERM become a reason to end in order, which the yielded function tells."""
    stopped: list[int] = []
    numbers = (signal.SIGINT, signal.SIGTERM)
    before: list[Any] = [signal.signal(n, lambda n, _: stopped.append(n)) for n in numbers]
    try:
        yield lambda: "it was interrupted" if stopped else ""
    finally:
        for number, handler in zip(numbers, before, strict=True):
            signal.signal(number, handler)
