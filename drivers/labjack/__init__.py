"""LabJack T7 (T4, T8): an analog output into the amplifier's EXT input, a voltage input.

Needs LabJack's LJM library and `pip install dehyst[labjack]`; the package is imported when a device
is opened. Tested with the package itself on a stand-in for the library, not on hardware.
"""

from dehyst.drivers.labjack.actuator import LabjackActuator
from dehyst.drivers.labjack.sensor import LabjackSensor

__all__ = ("LabjackActuator", "LabjackSensor")
