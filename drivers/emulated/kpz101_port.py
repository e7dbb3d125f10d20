"""The emulated KPZ101 as a serial port: the unit of kpz101_unit on a pty.

with Kpz101Emulator("/tmp/kpz101", Kpz101Knobs(limit_v=75), on_output=drive) as amplifier:
    ...; amplifier.fault(mute=True); amplifier.unplug(); amplifier.plug()
"""

import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

from msgspec import structs

from dehyst.drivers.emulated.kpz101_knobs import Kpz101Faults, Kpz101Knobs
from dehyst.drivers.emulated.kpz101_unit import Kpz101Unit
from dehyst.drivers.emulated.pty_device import PtyServer


class Kpz101Emulator(PtyServer):
    """A PtyServer with a Kpz101Unit. Everything here may be called from any thread; the plant
    receives the output in the serving thread."""

    unit: Kpz101Unit

    def __init__(
        self,
        link_path: str | Path,
        knobs: Kpz101Knobs | None = None,
        on_output: Callable[[float, float], None] = lambda volts, time_s: None,
        clock: Callable[[], float] = time.monotonic,
    ) -> None:
        super().__init__(Kpz101Unit(knobs, on_output, clock), link_path, clock)

    def fault(self, **changes: Any) -> None:
        """Switch faults (fields of Kpz101Faults) while it runs; unknown names raise TypeError."""
        self.call(lambda: self._set_faults(structs.replace(self.unit.faults, **changes)))

    def clear_faults(self) -> None:
        """A healthy unit again, and a port that takes bytes."""
        self.call(lambda: self._set_faults(Kpz101Faults()))
        self.stall_writes(False)

    def _set_faults(self, faults: Kpz101Faults) -> None:
        self.unit.faults = faults
