"""Choose which columns of a table are the time, the drive and the displacement, or ask."""
