"""From the search's last fit to what is said: names, rivals, shape, what has a time, limits."""
