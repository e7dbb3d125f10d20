"""Virtual scanning microscope on the simulated stage: shows what hysteresis does to an image."""
