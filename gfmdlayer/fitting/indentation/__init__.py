"""From measured force curves of an indenter to the moduli and times of the body under it."""
