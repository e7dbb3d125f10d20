"""Files on disk: recordings, trajectories, models. Read with the file named in every error, written
whole."""
