"""Reading tables of numbers, and writing files whole."""
