"""`dehyst bench`: compare hysteresis models through one interface on one set of recordings."""
