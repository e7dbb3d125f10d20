"""The axes of one controller: each one's parts, and what they have to do with each other."""
