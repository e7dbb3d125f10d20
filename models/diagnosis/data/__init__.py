"""What the recordings are: laid on their grids and joined, cut where they are long, their noise and
its colour, what must be said of them first, and where in them a misfit sits."""
