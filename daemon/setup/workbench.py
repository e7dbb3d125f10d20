"""Shared tools of the set-up's steps: the folder, its files, and playing a drive."""

from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path

from dehyst.daemon.acquire.axes import play_axes
from dehyst.daemon.acquire.early_end import signals_noted
from dehyst.daemon.acquire.one_axis import acquire
from dehyst.daemon.config import Config, load_config, load_controller
from dehyst.daemon.config.sections import usable_name
from dehyst.daemon.files.axis_columns import to_columns
from dehyst.daemon.files.known_units import ACTUATOR, open_known
from dehyst.daemon.files.outputs import file_of_axis
from dehyst.daemon.files.recordings import read_recording, write_recording
from dehyst.daemon.rings import run_folder
from dehyst.daemon.setup.journal import Journal
from dehyst.daemon.setup.questions import UserPrompts, Wishes
from dehyst.daemon.terminal.progress import progress_bar
from dehyst.drivers.interface import DeviceSpec
from dehyst.drivers.registry import load_actuator
from dehyst.models.errors import NotNow
from dehyst.models.recording import Floats, Recording

CONFIG, MODEL = "stage.toml", "stage.model.toml"
NAME = "stage-1"
Playing = tuple[Callable[[float], None], Callable[[], str]]
MADE = "# Written by `dehyst setup`, which replaces it if its limits, units or rate change.\n"


class Workbench:
    """One set-up. folder: where all files are written; say: prints one line for the user."""

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
        """The controller's name: the given one, otherwise the folder's if it is a valid name,
        otherwise NAME. So two stages on one machine have different names and run folders."""
        return self.wishes.name or usable_name(self.folder.resolve().name) or NAME

    @property
    def name_in_words(self) -> str:
        """Explain the controller's name if nobody chose it; "": it is the given one or the
        folder's."""
        folder = self.folder.resolve().name
        if self.wishes.name or usable_name(folder):
            return ""
        return (
            f"the controller's name is {NAME}, because {folder!r} is not a valid name (a-z, 0-9, - "
            "and _); --name gives it another"
        )

    @property
    def config_path(self) -> Path:
        """Path of the configuration, whether written by the user or by the set-up."""
        return self.folder / CONFIG

    @property
    def model_path(self) -> Path:
        """Path of the identified model."""
        return self.folder / MODEL

    def model_path_of(self, axis: str) -> Path:
        """Path of the identified model of one of several axes."""
        return self.in_folder(MODEL, axis)

    def in_folder(self, name: str, axis: str) -> Path:
        """Path of the file with this name for one of several axes."""
        return file_of_axis(self.folder / name, axis)

    @property
    def axes(self) -> tuple[str, ...]:
        """The names of the axes if there are several; () for one axis without a name."""
        if self.has_own_config():
            names = load_controller(self.config_path).axis_names
            return names if len(names) > 1 else ()
        if self.wishes.axes or self.wishes.axis or not self.journal.done("units"):
            return self.wishes.axes
        return tuple(self.journal.result("units").get("axes", ()))

    def config(self) -> Config:
        """Load the configuration from its file."""
        return load_config(self.config_path)

    def configs(self) -> dict[str, Config]:
        """Load the configuration of each of several axes, by axis name."""
        return {config.axis: config for config in load_controller(self.config_path).axes}

    def has_own_config(self) -> bool:
        """Return True if the user wrote the configuration."""
        return self.config_path.exists() and not self.config_path.read_text("utf-8").startswith(
            MADE
        )

    def put_aside(self, path: Path, text: str) -> Path | None:
        """Rename a file before it is replaced by another text, so that no user data is lost.
        Return the new path, or None if the file does not exist or already has this text."""
        if not path.exists() or path.read_text("utf-8") == text:
            return None
        aside = self._free(path.stem, path.suffix)
        return path.rename(aside)

    def _free(self, stem: str, suffix: str) -> Path:
        names = (self.folder / f"{stem}-{i}{suffix}" for i in range(1, 10_000))
        return next(path for path in names if not path.exists())

    def recording(self, step: str, axis: str = "") -> Recording:
        """Read the recording that a step made; axis: whose, if there are several."""
        result = self.journal.result(step)
        kept = result["axes"][axis] if axis else result
        return read_recording(self.folder / str(kept["recording"]), need_displacement=True)

    def output_now(self, config: Config) -> tuple[float, DeviceSpec]:
        """Return the present output as far as the unit reports it, and the unit's DeviceSpec.
        Moves nothing."""
        actuator = load_actuator(config.actuator.driver).from_settings(config.actuator.settings)
        try:
            open_known(config, ACTUATOR, actuator)
            return float(actuator.output()), actuator.spec
        finally:
            actuator.close()

    @contextmanager
    def driving(self, text: str) -> Iterator[Playing]:
        """Hold the outputs during the block, with a progress bar; Ctrl-C, SIGTERM and SIGHUP end it
        in order. Yield the progress and the function that returns the reason to end. Raises InUse
        while another process, such as the daemon, drives them."""
        folder = load_controller(self.config_path).directory
        with (
            run_folder.at_work(folder, run_folder.OUTPUT, "setup", self.config_path),
            progress_bar(text) as progress,
            signals_noted() as stopped,
        ):
            yield progress, lambda: "it was interrupted" if stopped else ""

    def play(self, t_s: Floats, volts: Floats, exercise_s: float, text: str) -> Recording:
        """Play voltages open loop after exercise_s of full loops, and record; the output returns
        to where it was. Raises NotNow if this ended early; what was recorded is then in a file."""
        config = self.config()
        drive = volts / config.actuator.gain
        with self.driving(text) as (progress, stop):
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
        """As `play`, for volts (N, axes) at the loop's rate; return the recording of each axis."""
        configs = list(self.configs().values())
        with self.driving(text) as (progress, stop):
            found, ended = play_axes(configs, t_s, volts_at, "v", exercise_s, progress, stop)
            if ended:
                paths = self.keep_axes(found, "unfinished").values()
                raise NotNow(
                    f"{ended}; what was recorded before is in {', '.join(map(str, paths))}. The "
                    "same command repeats it"
                )
        return found

    def keep_axes(self, recordings: Mapping[str, Recording], stem: str) -> dict[str, Path]:
        """As `keep`, for each axis; return the paths by axis."""
        return {axis: self.keep(one, f"{stem}-{axis}") for axis, one in recordings.items()}

    def keep(self, recording: Recording, stem: str) -> Path:
        """Write a recording under an unused name; return its path."""
        path = self._free(stem, ".csv")
        assert recording.displacement is not None
        columns = {
            recording.drive_column: recording.drive,
            recording.displacement_column: recording.displacement,
        }
        columns |= to_columns(recording.channels, recording.displacement_unit, recording.drive_unit)
        write_recording(path, recording.t_s, columns, {"source": "dehyst setup"})
        return path
