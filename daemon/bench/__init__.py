"""The simulated and the emulated bench that need no hardware: their configurations."""
