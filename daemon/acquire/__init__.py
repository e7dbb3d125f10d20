"""From a drive in volts to a recording: one axis, or several of one controller."""
