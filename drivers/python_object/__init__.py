"""Any Python object as an amplifier or a sensor: the settings name its methods."""

from dehyst.drivers.python_object.devices import PythonActuator, PythonSensor

__all__ = ("PythonActuator", "PythonSensor")
