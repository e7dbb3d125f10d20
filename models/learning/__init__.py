"""Where a gauge is used: the slow trim, and what repeats learned from pass to pass."""
