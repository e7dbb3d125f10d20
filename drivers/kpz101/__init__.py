"""Thorlabs KPZ101 and TPZ001 piezo drivers over serial: driver and settings."""

from dehyst.drivers.kpz101.driver import Kpz101

__all__ = ["Kpz101"]
