"""The doctor: a process that examines every mismatch. No network, no devices, lowest priority."""
