"""The page in a browser: a server of its own that is an ordinary client of the daemons."""
