"""Fits: laws to measured moduli, bodies to force curves of an indenter and to maps of them."""
