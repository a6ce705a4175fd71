"""Reading tables of numbers, writing files whole, and locks between processes."""
