"""From the history of the surface to the slopes and intercepts of the stress."""
