"""NI-DAQmx: an analog output into the amplifier's EXT input, a strain-gauge bridge in."""

from dehyst.drivers.nidaqmx.devices import NidaqmxActuator, NidaqmxSensor

__all__ = ("NidaqmxActuator", "NidaqmxSensor")
