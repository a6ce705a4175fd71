"""The periodic grid, its Fourier transforms and their plans, and sums over the grid."""
