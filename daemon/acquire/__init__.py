"""Open-loop recording with a drive in volts: one axis, or several axes of one controller."""
