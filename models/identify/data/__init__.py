"""Prepare recordings for the fit: usable rows, glitches removed, stretches held out."""
