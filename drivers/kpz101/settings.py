"""The settings of the KPZ101 driver."""

from dehyst.drivers.apt.settings import PiezoSettings


class Kpz101Settings(PiezoSettings, frozen=True):
    """Settings of one piezo driver."""

    driver = "kpz101"
