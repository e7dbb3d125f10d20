"""Linux IIO through sysfs: input from a bridge converter, analog output from a DAC."""

from dehyst.drivers.iio.actuator import IioActuator
from dehyst.drivers.iio.sensor import IioSensor

__all__ = ("IioActuator", "IioSensor")
