"""Emulated units on pseudo terminals, connected to the simulated stage."""
