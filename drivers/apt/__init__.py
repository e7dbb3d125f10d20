"""What Thorlabs' K-Cubes and T-Cubes share: the APT messages and the link to one unit."""
