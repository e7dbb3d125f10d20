"""Thorlabs KSG101 and TSG001 strain gauge readers over serial: driver, settings, probe."""

from dehyst.drivers.ksg101.driver import Ksg101

__all__ = ["Ksg101"]
