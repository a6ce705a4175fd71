"""Projected conjugate gradients with nested grids for large rough surfaces; see `solver` for the method."""
