"""Data shared by the processes: records, and the rings that carry them."""
