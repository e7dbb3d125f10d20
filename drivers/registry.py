"""Driver plugins: found through entry points, loaded on request.

A package adds a driver with an entry point in its own pyproject.toml:

    [project.entry-points."dehyst.actuators"]
    myamp = "mypackage.amplifier:MyAmp"

The class implements Actuator or Sensor (dehyst.drivers.interface); dehyst.drivers.contract contains
the tests that prove it. A plugin that cannot be loaded is listed with its error, never dropped.
"""

import inspect
from collections.abc import Iterable
from dataclasses import dataclass
from importlib.metadata import EntryPoint, entry_points

from dehyst.drivers.interface import Actuator, DriverConfigError, Sensor
from dehyst.drivers.settings import SettingKey, Settings, list_keys

ACTUATORS = "dehyst.actuators"
SENSORS = "dehyst.sensors"
KINDS = {ACTUATORS: "actuator", SENSORS: "sensor"}
METHODS = {
    ACTUATORS: ("from_settings", "open", "write", "output", "reconnect", "close"),
    SENSORS: ("from_settings", "open", "read", "reconnect", "close"),
}


@dataclass(frozen=True)
class Plugin:
    """One driver that was found. kind: "actuator" or "sensor"; where: "module:Class"; package: the
    distribution that contains it and its version; summary: first line of its documentation; error:
    why it cannot be used, "" if it can."""

    name: str
    kind: str
    where: str
    package: str
    summary: str
    error: str


def list_plugins() -> list[Plugin]:
    """Return every driver of both kinds, by kind and name, including the broken ones with their
    error. Loads all of them."""
    of_kind = {group: _points(group) for group in KINDS}  # reads what is installed each time
    return [_describe(group, one, points) for group, points in of_kind.items() for one in points]


def find_plugins(name: str) -> list[Plugin]:
    """Return the drivers of this name, actuator and sensor. Raises DriverConfigError when there are
    none (it lists those that exist)."""
    found = [p for p in list_plugins() if p.name == name]
    if not found:
        names = sorted({point.name for group in KINDS for point in _points(group)})
        raise DriverConfigError(
            f"there is no driver {name!r} (a new one is found once its package is installed again: "
            f"pip install -e .); the drivers are: {', '.join(names)}"
        )
    return found


def list_settings(plugin: Plugin) -> list[SettingKey] | None:
    """Return a driver's settings; None if it is broken or does not declare them
    (`settings_type`)."""
    group = next(group for group, kind in KINDS.items() if kind == plugin.kind)
    points = [p for p in _points(group) if (p.name, p.value) == (plugin.name, plugin.where)]
    found, _ = _try(group, points[0])
    kind = getattr(found, "settings_type", None)
    return list_keys(kind) if isinstance(kind, type) and issubclass(kind, Settings) else None


def load_actuator(name: str) -> type[Actuator]:
    """Return the class of an actuator driver. Raises DriverConfigError when none has this name (it
    lists those that exist) or when it cannot be loaded (with its error)."""
    return _load(ACTUATORS, name)


def load_sensor(name: str) -> type[Sensor]:
    """Return the class of a sensor driver; errors as in load_actuator."""
    return _load(SENSORS, name)


def _load(group: str, name: str) -> type:
    points = _points(group)
    chosen = [point for point in points if point.name == name]
    if not chosen:
        names = ", ".join(sorted({point.name for point in points})) or "none"
        raise DriverConfigError(
            f"there is no {KINDS[group]} driver {name!r}; the drivers are: {names}"
        )
    error = _clash(chosen[0], points)
    if not error:
        found, error = _try(group, chosen[0])
        if found is not None:
            return found
    raise DriverConfigError(
        f"the {KINDS[group]} driver {name!r} ({chosen[0].value}) cannot be used: {error}"
    )


def _points(group: str) -> list[EntryPoint]:
    """Return a group's entry points, each once (an editable install may list its own twice)."""
    unique = {(p.name, p.value): p for p in entry_points(group=group)}
    return [unique[key] for key in sorted(unique)]


def _describe(group: str, point: EntryPoint, points: Iterable[EntryPoint]) -> Plugin:
    error = _clash(point, points)
    found, fault = _try(group, point)
    if found is None:
        summary = ""
    else:
        text = inspect.getdoc(found) or inspect.getdoc(inspect.getmodule(found)) or ""
        summary = " ".join(text.split("\n\n")[0].split())
    package = f"{point.dist.name} {point.dist.version}" if point.dist else "unknown"
    return Plugin(point.name, KINDS[group], point.value, package, summary, error or fault)


def _clash(point: EntryPoint, points: Iterable[EntryPoint]) -> str:
    others = [p.value for p in points if p.name == point.name and p.value != point.value]
    return f"the name is also taken by {', '.join(others)}" if others else ""


def _try(group: str, point: EntryPoint) -> tuple[type | None, str]:
    """Return the class at an entry point, or the reason why it cannot be used."""
    try:
        found = point.load()
    except Exception as error:  # whatever a plugin raises while it is imported
        return None, f"{type(error).__name__}: {' '.join(str(error).split())}"
    if not isinstance(found, type):
        return None, f"it is a {type(found).__name__}, not a class"
    missing = [name for name in METHODS[group] if not callable(getattr(found, name, None))]
    if missing:
        return None, f"it lacks {', '.join(missing)} of the {KINDS[group]} interface"
    return found, ""
