"""One step of the simulation: the contact problem on the grid and its solvers."""
