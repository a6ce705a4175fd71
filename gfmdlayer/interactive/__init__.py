"""Functions for scripts and notebooks: a whole run, or one elastic contact, as labelled data in memory."""
