"""The whole model, forward and inverse: drive blocks, hysteresis, stage blocks, sensor blocks."""
