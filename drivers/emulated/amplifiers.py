"""The amplifier of the emulated bench: makes the unit that its knobs describe, on its port.

driver    knobs           axes of the stage                gauges
mdt693b   Mdt693bKnobs    its own, x, y, z or x alone      a KSG101 for each axis
kpz101    Kpz101Knobs     one, with any name               a KSG101
kpc101    Kpc101Knobs     one, with any name               its own
bpc303    RACK_KNOBS      x, y, z are its channels 1 to 3  its own, for each axis of the stage
"""

import functools
from collections.abc import Callable, Sequence
from pathlib import Path

from dehyst.drivers.apt.codec import BAYS
from dehyst.drivers.emulated.kpc101_unit import (
    AXES,
    RACK_KNOBS,
    Bpc303Unit,
    Kpc101Knobs,
    Kpc101Unit,
)
from dehyst.drivers.emulated.kpz101_knobs import Kpz101Knobs
from dehyst.drivers.emulated.kpz101_unit import Kpz101Unit
from dehyst.drivers.emulated.mdt693b_knobs import Mdt693bKnobs
from dehyst.drivers.emulated.mdt693b_port import Mdt693bEmulator
from dehyst.drivers.emulated.pty_device import PtyServer
from dehyst.drivers.interface import DriverConfigError


class AptEmulator(PtyServer):
    """A PtyServer with a piezo driver or controller."""

    unit: Kpz101Unit | Bpc303Unit


Knobs = Mdt693bKnobs | Kpz101Knobs
Amplifier = Mdt693bEmulator | AptEmulator
Output = Callable[[str, float, float], None]
"""Sets the voltage of an axis from a given time on."""
Position = Callable[[str, float], float]
"""Returns the position of an axis at a given time [um]."""


def has_gauges(knobs: Knobs) -> bool:
    """Return whether the unit reads the gauges itself."""
    return isinstance(knobs, Kpc101Knobs)


def check_axes(knobs: Knobs, axes: Sequence[str]) -> None:
    """Raise DriverConfigError if the unit cannot drive a stage with these axes."""
    if isinstance(knobs, Kpz101Knobs) and knobs.model != RACK_KNOBS.model:
        if len(axes) > 1:
            raise DriverConfigError(
                f"a {knobs.model} has one axis, but the stage has {', '.join(axes)}"
            )
        return
    known = knobs.axes if isinstance(knobs, Mdt693bKnobs) else AXES[: _bays(knobs)]
    for axis in axes:
        if axis not in known:
            raise DriverConfigError(f"the amplifier has axes {known}, no {axis}")


def make_amplifier(
    folder: Path,
    knobs: Knobs,
    axes: Sequence[str],
    on_output: Output,
    position: Position,
    clock: Callable[[], float],
) -> Amplifier:
    """Make the unit on its port in `folder`, named like its driver. axes: of the stage; position is
    called by units with gauges of their own."""
    if isinstance(knobs, Mdt693bKnobs):
        return Mdt693bEmulator(folder / "mdt693b", knobs, on_output, clock)
    drive = functools.partial(on_output, axes[0])
    if not isinstance(knobs, Kpc101Knobs):
        return AptEmulator(Kpz101Unit(knobs, drive, clock), folder / "kpz101", clock)
    if knobs.model != RACK_KNOBS.model:
        unit = Kpc101Unit(
            knobs,
            lambda channel, volts, time_s: drive(volts, time_s),
            lambda channel, time_s: position(axes[0], time_s),
            clock,
        )
        return AptEmulator(unit, folder / "kpc101", clock)
    rack = Bpc303Unit(
        knobs,
        lambda channel, volts, time_s: on_output(AXES[channel - 1], volts, time_s),
        lambda channel, time_s: position(AXES[channel - 1], time_s),
        clock,
    )
    for axis, address in zip(AXES, rack.channels, strict=False):
        rack.channels[address].gauge_connected &= axis in axes
    return AptEmulator(rack, folder / "bpc303", clock)


def _bays(knobs: Knobs) -> int:
    return knobs.bays if isinstance(knobs, Kpc101Knobs) else len(BAYS)
