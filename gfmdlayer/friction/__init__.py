"""Frictional contact of one step: pressure and shear traction of a surface that sticks and slips."""
