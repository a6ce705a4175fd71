"""Files of results: HDF5 files of cases and sweeps, checkpoints, and their readers."""
