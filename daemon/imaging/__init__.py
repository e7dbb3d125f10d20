"""A virtual scanning microscope on the simulated stage: what hysteresis does to a picture."""
