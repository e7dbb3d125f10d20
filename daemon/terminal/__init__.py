"""What is drawn on a terminal: live view, progress."""
