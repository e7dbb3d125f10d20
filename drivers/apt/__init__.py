"""What Thorlabs' K-Cubes and T-Cubes have in common: the APT messages and the link to one unit."""
