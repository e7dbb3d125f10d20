"""A subset of PI's General Command Set 2.0 on TCP, served by an ordinary client of the bus."""
