"""Simulates another operating system for dehyst, in every interpreter with this on its path.

Only dehyst's modules see it; the libraries that they use keep this machine's system. Modules and
names that $OTHER_SYSTEM lists as missing (JSON: platform, modules, names by module) cannot be
imported or read by them, `sys.platform` is the other one, and /proc cannot be opened.
"""

import builtins
import json
import os
import sys
from types import ModuleType

OTHER = json.loads(os.environ["OTHER_SYSTEM"])
ORIGINAL = builtins.__import__


class Deprived(ModuleType):
    """A module without the names that the other system lacks."""

    def __init__(self, real: ModuleType, missing: set[str], instead: dict) -> None:
        super().__init__(real.__name__)
        self.__dict__.update(_real=real, _missing=missing, **instead)

    def __getattr__(self, name: str) -> object:
        if name in self.__dict__["_missing"]:
            raise AttributeError(f"{OTHER['platform']} has no {self.__name__}.{name}")
        return getattr(self.__dict__["_real"], name)

    def __setattr__(self, name: str, value: object) -> None:
        setattr(self.__dict__["_real"], name, value)


def no_library(name: object, *_: object, **__: object) -> None:
    if name is None:
        raise TypeError(f"{OTHER['platform']} has no such library")
    raise OSError(f"{name}: no such library")


INSTEAD = {"sys": {"platform": OTHER["platform"]}, "ctypes": {"CDLL": no_library}}
made: dict[str, Deprived] = {}


def deprived(name: str) -> Deprived:
    if name not in made:
        missing = set(OTHER["names"].get(name, ()))
        made[name] = Deprived(sys.modules[name], missing, INSTEAD.get(name, {}))
    return made[name]


def is_dehyst(package: object) -> bool:
    return str(package).split(".")[0] == "dehyst"


def importing(name, globals=None, locals=None, fromlist=(), level=0):
    found = ORIGINAL(name, globals, locals, fromlist, level)
    if level or not is_dehyst((globals or {}).get("__package__")):
        return found
    if name in OTHER["modules"]:
        raise ModuleNotFoundError(f"{OTHER['platform']} has no {name}", name=name)
    known = name in OTHER["names"] or name in INSTEAD
    return deprived(name) if known else found


def opening(event: str, given: tuple) -> None:
    if event not in ("open", "os.listdir", "os.scandir") or not str(given[0]).startswith("/proc/"):
        return
    frame = sys._getframe(1)
    while frame is not None:
        package = frame.f_globals.get("__package__") or frame.f_globals.get("__name__", "")
        if is_dehyst(package):
            raise FileNotFoundError(2, "No such file or directory", str(given[0]))
        if package.split(".")[0] not in sys.stdlib_module_names:
            return
        frame = frame.f_back


builtins.__import__ = importing
sys.addaudithook(opening)
