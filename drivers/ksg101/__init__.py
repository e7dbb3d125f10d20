"""Thorlabs KSG101 and TSG001 strain gauge readers over serial: driver, codec, settings."""

from dehyst.drivers.ksg101.driver import Ksg101

__all__ = ["Ksg101"]
