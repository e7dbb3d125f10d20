"""Thorlabs MDT693B and MDT694B piezo amplifiers over serial: driver, codec, settings, probe."""

from dehyst.drivers.mdt693b.driver import Mdt693b, Mdt694b

__all__ = ["Mdt693b", "Mdt694b"]
