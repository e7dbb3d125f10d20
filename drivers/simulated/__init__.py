"""The simulated stage and its devices, in this process. No real device needs this package."""
