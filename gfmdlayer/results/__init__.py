"""What a run leaves behind: HDF5 files, xarray datasets, figures."""
