"""Groups of MPI ranks, each of which computes a case together, on a grid over its ranks (`grid.slabs`)."""
