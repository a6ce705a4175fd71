"""The primal-dual active-set solver; see `solver` for the method."""
