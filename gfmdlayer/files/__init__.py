"""Reading tables of numbers and HDF5, writing files whole, and locks between processes."""
