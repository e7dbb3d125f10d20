"""The inverse of the model: static, over a window of targets, and of a whole trajectory."""
