"""What the processes share: records, and the rings that carry them."""
