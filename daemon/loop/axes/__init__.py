"""The axes of one controller: the parts of each axis, and the coordination between axes."""
