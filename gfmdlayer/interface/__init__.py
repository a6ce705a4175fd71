"""Interaction of surface and punch across the gap: energy, traction and curvature of interface laws."""
