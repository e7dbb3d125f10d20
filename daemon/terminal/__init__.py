"""Output drawn on a terminal: live view, progress."""
