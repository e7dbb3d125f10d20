"""The commands of `dehyst`, one file for each, thin."""
