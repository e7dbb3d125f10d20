"""The doctor: a process that looks into every mismatch. No network, no devices, lowest priority."""
