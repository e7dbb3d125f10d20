"""Files that `dehyst demo` writes; light to import."""

OUTPUTS = (
    "recording.csv",
    "trajectory.csv",
    "track-linear.csv",
    "track-compensated.csv",
    "model.toml",
    "demo.png",
    "story.png",
)
