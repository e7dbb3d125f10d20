"""The report of a search: names, rivals, shape, episodes in time, limits."""
