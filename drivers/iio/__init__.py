"""Linux IIO through sysfs: a bridge converter in, a converter's analog voltage out."""

from dehyst.drivers.iio.actuator import IioActuator
from dehyst.drivers.iio.sensor import IioSensor

__all__ = ("IioActuator", "IioSensor")
