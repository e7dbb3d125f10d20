"""One MDT693B and the outputs of it that this process drives: one port, one conversation.

The drivers of the outputs share the link. When one of them loses it, all lose it: the others' next
calls raise DeviceGone without touching the port, and the first `reconnect()` that succeeds makes a
link for all of them. Calls come from the loop's thread and from threads that reconnect; each step
of the conversation holds `lock`, and nobody waits for a lost unit.
"""

import os
import threading
from collections.abc import Callable
from weakref import WeakValueDictionary

from dehyst.drivers.interface import DeviceNotFound, DriverConfigError
from dehyst.drivers.mdt693b.link import Mdt693bLink
from dehyst.drivers.mdt693b.settings import Mdt69xConfig

OF_THE_LINK = ("timeout_s", "write_timeout_s", "idle_s", "baud", "serial_number")


class SharedUnit:
    """A unit's link and outputs. link: None if none is open; lost: why it cannot be used any more,
    "" if it can."""

    def __init__(self, config: Mdt69xConfig) -> None:
        self.config = config
        self.lock = threading.RLock()
        self.link: Mdt693bLink | None = None
        self.lost = ""
        self._outputs: dict[str, object] = {}

    @property
    def shared(self) -> bool:
        """Return whether several outputs are driven."""
        return len(self._outputs) > 1

    def claim(self, config: Mdt69xConfig, output: object) -> None:
        """Register an output. Raises DeviceNotFound if another driver drives it, DriverConfigError
        if the settings of the link differ."""
        with self.lock:
            if not self._outputs:
                self.config = config  # no other output's settings need to match
            if self._outputs.setdefault(config.axis, output) is not output:
                raise DeviceNotFound(
                    f"{config.port}: output {config.axis} is in use in this process already"
                )
            for name in OF_THE_LINK:
                mine, theirs = getattr(config, name), getattr(self.config, name)
                if mine != theirs:
                    del self._outputs[config.axis]
                    raise DriverConfigError(
                        f"setting {name}: {mine!r} for output {config.axis}, and {theirs!r} for "
                        f"another output of the same unit at {config.port}"
                    )

    def release(self, axis: str, output: object) -> Mdt693bLink | None:
        """Unregister an output. Return the link, to be closed, if it was the last one."""
        with self.lock:
            if self._outputs.get(axis) is output:
                del self._outputs[axis]
            if self._outputs:
                return None
            link, self.link, self.lost = self.link, None, ""
            return link

    def connect(self, make: Callable[[], Mdt693bLink]) -> Mdt693bLink:
        """Return the link, after making a new one if there is none or it is lost."""
        with self.lock:
            if self.link is not None and self.lost:
                self.link.close()
                self.link = None
            if self.link is None:
                self.link = make()
                self.lost = ""
            return self.link

    def lose(self, why: Exception) -> None:
        """Mark the link as lost; if outputs share it, none may use it until a new one is made."""
        if self.shared and not self.lost:
            self.lost = str(why) or type(why).__name__


_units: WeakValueDictionary[str, SharedUnit] = WeakValueDictionary()
_making = threading.Lock()


def shared_unit(config: Mdt69xConfig) -> SharedUnit:
    """Return the unit at a configured port, the same one for all its outputs."""
    auto = config.port == "auto"
    key = f"auto {config.usb_ids}" if auto else os.path.realpath(config.port)
    with _making:
        unit = _units.get(key)
        if unit is None:
            unit = _units[key] = SharedUnit(config)
        return unit
