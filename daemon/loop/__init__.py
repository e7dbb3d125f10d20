"""The real-time process: step, targets, devices, the Python loop and the compiled loop."""
