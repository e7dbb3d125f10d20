"""Check that recordings, and their model, can be of a stage of this class."""
