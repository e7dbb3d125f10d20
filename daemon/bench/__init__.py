"""Configurations of the simulated and the emulated bench, which need no hardware."""
