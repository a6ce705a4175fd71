"""Isolated axisymmetric indentation: force and contact radius of a rigid indenter, by Abel transforms."""
