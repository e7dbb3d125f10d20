"""Emulated units on pseudo terminals, with the simulated stage behind them."""
