"""`dehyst bench`: models of hysteresis behind one interface, on one set of recordings."""
