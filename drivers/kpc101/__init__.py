"""Thorlabs KPC101, BPC301 and BPC303 over serial: outputs and their strain gauges."""

from dehyst.drivers.kpc101.actuator import Bpc303, Kpc101
from dehyst.drivers.kpc101.sensor import Bpc303Sensor, Kpc101Sensor

__all__ = ["Bpc303", "Bpc303Sensor", "Kpc101", "Kpc101Sensor"]
