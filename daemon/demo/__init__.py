"""The story of `dehyst demo`: two acts, what is drawn by chance, how busy the machine is."""
