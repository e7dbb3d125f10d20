"""A part of PI's General Command Set 2.0 on TCP, spoken by an ordinary client of the bus."""
