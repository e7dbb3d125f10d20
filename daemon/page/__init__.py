"""The browser page: a separate server that is an ordinary client of the daemons."""
