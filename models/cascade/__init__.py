"""The whole model: drive blocks, hysteresis, stage blocks, sensor blocks, forward and undone."""
