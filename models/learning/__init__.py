"""Corrections from a gauge: the slow trim, and learning of repeating errors from pass to pass."""
