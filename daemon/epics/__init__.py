"""EPICS process variables of a controller, served by an ordinary client of the bus."""
