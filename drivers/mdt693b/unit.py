"""One MDT693B and those of its outputs that this process drives: one port, one conversation.

The drivers of the outputs share the link. When it is lost for one of them it is lost for all: the
others' next calls raise DeviceGone without touching the port, and the first `reconnect()` that
succeeds makes a link for all of them. Calls come from the loop's thread and from those that
reconnect; each conversation step holds `lock`, and nobody waits for a unit that is lost.
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
    """link: the open one, None: none; lost: why it cannot be used any more, "": it can."""

    def __init__(self, config: Mdt69xConfig) -> None:
        self.config = config
        self.lock = threading.RLock()
        self.link: Mdt693bLink | None = None
        self.lost = ""
        self._outputs: dict[str, object] = {}

    @property
    def shared(self) -> bool:
        """Whether several outputs are driven."""
        return len(self._outputs) > 1

    def claim(self, config: Mdt69xConfig, output: object) -> None:
        """Drive an output. Raises DeviceNotFound where another driver does, DriverConfigError
        where the settings of the link differ."""
        with self.lock:
            if not self._outputs:
                self.config = config  # nobody is left whose settings count
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
        """Drive an output no more; the link where it was the last one's: to be closed."""
        with self.lock:
            if self._outputs.get(axis) is output:
                del self._outputs[axis]
            if self._outputs:
                return None
            link, self.link, self.lost = self.link, None, ""
            return link

    def connect(self, make: Callable[[], Mdt693bLink]) -> Mdt693bLink:
        """The link; made anew where there is none, or where it is lost."""
        with self.lock:
            if self.link is not None and self.lost:
                self.link.close()
                self.link = None
            if self.link is None:
                self.link = make()
                self.lost = ""
            return self.link

    def lose(self, why: Exception) -> None:
        """The link failed: where others share it, none may use it before it is made anew."""
        if self.shared and not self.lost:
            self.lost = str(why) or type(why).__name__


_units: WeakValueDictionary[str, SharedUnit] = WeakValueDictionary()
_making = threading.Lock()


def shared_unit(config: Mdt69xConfig) -> SharedUnit:
    """The unit behind a configured port, the same one for all outputs of it."""
    auto = config.port == "auto"
    key = f"auto {config.usb_ids}" if auto else os.path.realpath(config.port)
    with _making:
        unit = _units.get(key)
        if unit is None:
            unit = _units[key] = SharedUnit(config)
        return unit
