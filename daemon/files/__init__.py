"""Files on disk: recordings, trajectories, models. Every read error names the file; files are
written completely or not at all."""
