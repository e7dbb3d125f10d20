"""When the loop wakes, what kept it, and how the process gets its priority."""
