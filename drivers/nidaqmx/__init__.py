"""NI-DAQmx: an analog output into the amplifier's EXT input, a voltage or bridge input.

Needs the NI driver software and `pip install dehyst[nidaqmx]`; the package is imported when a
device is opened. Tested with stand-ins for the vendor's package and library, not on hardware.
"""

from dehyst.drivers.nidaqmx.actuator import NidaqmxActuator
from dehyst.drivers.nidaqmx.sensor import NidaqmxSensor

__all__ = ("NidaqmxActuator", "NidaqmxSensor")
