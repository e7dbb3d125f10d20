"""The process with the deadline: step, targets, devices, the Python loop and the compiled one."""
