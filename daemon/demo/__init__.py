"""The two parts of `dehyst demo`, its randomly drawn effect, and a measure of how busy the machine
is."""
