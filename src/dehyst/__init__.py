"""dehyst: hysteresis compensation service for piezo stages."""

__version__ = "0.1.0"
