"""The recordings: laid on their grids and joined, cut where they are long, their noise and its
colour, the warnings that come first, and where in them a misfit is."""
