"""The commands of `dehyst`, one thin module per command."""
