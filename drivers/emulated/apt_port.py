"""An emulated APT unit as a serial port: a unit of this package on a pty, with its faults.

with AptEmulator(Kpc101Unit(Kpc101Knobs(limit_v=75)), "/tmp/kpc101") as amplifier:
    ...; amplifier.fault(mute=True); amplifier.unplug(); amplifier.plug()
"""

import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

from msgspec import structs

from dehyst.drivers.emulated.kpc101_unit import Bpc303Unit
from dehyst.drivers.emulated.kpz101_unit import Kpz101Unit
from dehyst.drivers.emulated.pty_device import PtyServer


class AptEmulator(PtyServer):
    """A PtyServer with a piezo driver or controller. All methods may be called from any thread; the
    plant receives the output in the serving thread. clock: the unit's."""

    unit: Kpz101Unit | Bpc303Unit

    def __init__(
        self,
        unit: Kpz101Unit | Bpc303Unit,
        link_path: str | Path,
        clock: Callable[[], float] = time.monotonic,
    ) -> None:
        super().__init__(unit, link_path, clock)

    def fault(self, **changes: Any) -> None:
        """Switch faults (the unit's fields) at run time; unknown names raise TypeError."""
        self.call(lambda: self._set_faults(structs.replace(self.unit.faults, **changes)))

    def clear_faults(self) -> None:
        """Restore a healthy unit and a port that accepts bytes."""
        self.call(lambda: self._set_faults(type(self.unit.faults)()))
        self.stall_writes(False)

    def _set_faults(self, faults: Any) -> None:
        self.unit.faults = faults
