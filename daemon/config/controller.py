"""A controller and its axes: one file, one clock, one amplifier, and a Config for each axis.

In a file with [axis.x], [axis.y], ..., each axis table holds the sections of that axis (OWN).
The sections in SHARED appear only at top level and apply to all axes. The sections of an axis may
also appear at top level as defaults: the axis' table is merged over the shared one, recursively
and key by key, so that

    [actuator]
    driver = "mdt693b"
    settings = {port = "/dev/ttyACM0"}
    [axis.x.actuator.settings]
    axis = "x"

names the port once. A table with a different `driver` from the shared one replaces it entirely.
With a shared `watch.directory`, each axis keeps its recordings in its own subfolder there.

A file without [axis] has one unnamed axis and no subfolders.
"""

import os
import re
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from dehyst.daemon.config.checked_tables import check_tables
from dehyst.daemon.config.file import checked_config, read_tables, resolved_config
from dehyst.daemon.config.sections import (
    BusConfig,
    Config,
    LoopConfig,
    PageConfig,
    TelemetryConfig,
    run_directory,
)
from dehyst.models.errors import BadInput

SHARED = ("name", "loop", "bus", "telemetry", "page", "run_dir")
OWN = (
    *("model", "actuator", "sensor", "limits", "channels", "safe"),
    *("setpoint", "inverse", "trim", "watch", "doctor"),
)
AXIS_NAME = re.compile(r"[a-z0-9]{1,8}")


@dataclass(frozen=True)
class Controller:
    """The axes that one core process and one gateway process serve.

    name: the controller's name, NAME; axes: one Config each, named NAME-AXIS, or NAME if the file
    has no [axis]; directory: run directory with the processes' locks. An axis' rings are in
    `Config.directory`: DIRECTORY/AXIS, or DIRECTORY itself without [axis].
    """

    name: str
    axes: tuple[Config, ...]
    directory: Path

    @property
    def loop(self) -> LoopConfig:
        """[loop], shared by all axes: they have one clock."""
        return self.axes[0].loop

    @property
    def bus(self) -> BusConfig:
        """[bus], shared by all axes: they have one session."""
        return self.axes[0].bus

    @property
    def telemetry(self) -> TelemetryConfig:
        """[telemetry], shared by all axes."""
        return self.axes[0].telemetry

    @property
    def page(self) -> PageConfig | None:
        """[page], shared by all axes; None if the file does not have it."""
        return self.axes[0].page

    @property
    def period_ns(self) -> int:
        """Sampling period in integer nanoseconds."""
        return self.axes[0].period_ns

    @property
    def longest_ramp_s(self) -> float:
        """Longest time that any axis needs to ramp to its safe voltage [s]."""
        return max(config.longest_ramp_s for config in self.axes)

    @property
    def axis_names(self) -> tuple[str, ...]:
        """The axes' names in the order of the file; ("",) without [axis]."""
        return tuple(config.axis for config in self.axes)


def load_controller(path: str | Path) -> Controller:
    """Read a controller and the Config of each of its axes from a file. Raises BadInput."""
    path = Path(path)
    data = read_tables(path)
    if not isinstance(data.get("axis", {}), dict):
        raise BadInput(f"{path}: axis must have a table for each axis: [axis.x]")
    if "axis" not in data:
        config = resolved_config(checked_config(data, str(path)), path.parent)
        return Controller(config.name, (config,), config.directory)
    return _several(data, path)


def load_config(path: str | Path, axis: str = "") -> Config:
    """Read the Config of one axis; its paths are relative to the file. axis: its name, needed if
    there are several. Raises BadInput, which lists the existing axes."""
    controller = load_controller(path)
    if not axis and len(controller.axes) == 1:
        return controller.axes[0]
    names = ", ".join(controller.axis_names)
    if not axis:
        raise BadInput(f"{path}: it has the axes {names}; choose one with --axis NAME")
    for config in controller.axes:
        if config.axis == axis:
            return config
    has = f"the axes {names}" if names else "one axis, without a name"
    raise BadInput(f"{path}: there is no axis {axis!r}; it has {has}")


def _several(data: dict[str, Any], path: Path) -> Controller:
    axes = data["axis"]
    # at top level is what all axes share: their defaults need not be complete
    top = {key: value for key, value in data.items() if key != "axis"}
    check_tables(Config, top, str(path), whole=False, only=(*SHARED, *OWN))
    if not axes:
        raise BadInput(f"{path}: [axis] needs a table for each axis: [axis.x]")
    check_tables(Config, {key: top[key] for key in top if key == "name"}, str(path), only=("name",))
    name = data["name"]
    directory = run_directory(name, data.get("run_dir", ""))
    configs = tuple(_axis(data, axis, directory, path) for axis in axes)
    _check_together(configs, path)
    return Controller(name, configs, directory)


def _axis(data: dict[str, Any], axis: str, directory: Path, path: Path) -> Config:
    own, where = data["axis"][axis], f"{path}: axis {axis}"
    if not AXIS_NAME.fullmatch(axis):
        raise BadInput(f"{path}: axis {axis!r}: a name has one to eight characters of a-z and 0-9")
    if not isinstance(own, dict):
        raise BadInput(f"{path}: axis.{axis} must be a table: [axis.{axis}]")
    for key in own:
        if key in SHARED:
            raise BadInput(f"{where}: `{key}` is for all axes and belongs at top level")
    check_tables(Config, own, str(path), section=f"axis.{axis}", whole=False, only=OWN)
    shared = {key: value for key, value in data.items() if key in SHARED}
    merged = shared | {
        key: _laid_over(data.get(key), own.get(key)) for key in OWN if key in data or key in own
    }
    checked_config(merged | {"axis": axis}, where)  # before adding names and folders
    merged |= {"name": f"{data['name']}-{axis}", "axis": axis}
    merged["run_dir"] = os.fspath(directory / axis)
    kept = data.get("watch", {}).get("directory", "")
    if kept and "directory" not in own.get("watch", {}):
        merged["watch"] = merged["watch"] | {"directory": os.fspath(Path(kept) / axis)}
    return resolved_config(checked_config(merged, where), path.parent)


def _laid_over(shared: Any, own: Any) -> Any:
    """Merge an axis' table over the shared one."""
    if own is None or shared is None:
        return shared if own is None else own
    if not isinstance(shared, dict) or not isinstance(own, dict):
        return own
    if "driver" in shared and own.get("driver", shared["driver"]) != shared["driver"]:
        return own
    return {key: _laid_over(shared.get(key), own.get(key)) for key in shared | own}


def _check_together(configs: tuple[Config, ...], path: Path) -> None:
    names = [config.axis for config in configs]
    for i, config in enumerate(configs):
        for other in configs[:i]:
            for part in ("actuator", "sensor"):
                mine, theirs = getattr(config, part), getattr(other, part)
                if (mine.driver, mine.settings) == (theirs.driver, theirs.settings):
                    raise BadInput(
                        f"{path}: axes {other.axis} and {config.axis} have the same {part} "
                        f"({mine.driver} with the same settings); each needs its own: "
                        f"[axis.{config.axis}.{part}.settings]"
                    )
        for channel, follows in config.channels.items():
            if follows.axis and follows.axis not in names:
                raise BadInput(
                    f"{path}: axis {config.axis}: channels.{channel} follows axis {follows.axis}; "
                    f"the axes are: {', '.join(names)}"
                )
