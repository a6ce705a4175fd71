"""Closed forms of elastic contact, and bounds on the errors of the grid and of the solver.

The grid.  Near the edge of contact the pressure is k s^(1/2) a distance s inside; a grid of spacing D changes
the energy by k^2 D^3/E* times a periodic function of where between two points the edge lies, and the mean
pressure, its derivative by the depth, by k^2 D^2/E* da/d(depth) times another.  In a period L with a contact
of half-width a, psi = pi a/L, growing contact adds the pressure of a flat strip:

    k^2 = (2 L/pi) (d pbar/da)^2 cot psi,        d(depth)/d pbar = -(2 L/(pi E*)) ln sin psi

so the error is C D^2 (d pbar/da) cot psi/(-L ln sin psi).  C is a pure number of the grid, the same for every
smooth punch: between -0.247 and 0.131, with a mean of zero over the places of the edge.

The solver.  At a residual r stray pressures e on the open surface stay below r p_max and stray gaps g in
contact below r depth.  With u' and p' the response of the surface to a unit of depth at the same contact,
Betti's reciprocity makes of them an error <e (1 + u')> + <p' g> of the mean pressure; 1 + u' is zero in
contact, not negative outside, and one in the mean, and <p'> = d pbar/d(depth).  So it is at most

    r (p_max + depth d pbar/d(depth)).

In a viscoelastic body, earlier surfaces that are off by as much are resisted by at most Ginf/G0 of it.
"""

from __future__ import annotations

import math

import numpy as np
from scipy.optimize import brentq
from scipy.special import spence

from gfmdlayer.arrays import FloatArray

E_STAR = 4.0  # 2 G/(1 - nu) of an incompressible body with G = 1
RADIUS = 0.25  # of the paper's punch, in periods
DEPTH = 0.01  # of the paper's ramp
GRID = 0.25  # |C|

JOHNSON = "Johnson, Contact Mechanics (1985)"
PARABOLA = "periodic parabola, closed form; Johnson (1985), ch. 13"


def parabola_depth(half_width: float | FloatArray) -> FloatArray:
    """Depth (L^2/(4 pi^2 R)) [pi^2/6 - Li2(cos^2 psi)] of the paper's punch on an elastic halfspace."""
    return np.asarray((np.pi**2 / 6 - spence(np.sin(np.pi * half_width) ** 2)) / (4 * np.pi**2 * RADIUS))


def parabola_pressure(half_width: float | FloatArray) -> FloatArray:
    """Mean pressure -(E* L/(2 pi R)) ln cos psi of the paper's punch, for G = 1."""
    return np.asarray(-E_STAR / (2 * np.pi * RADIUS) * np.log(np.cos(np.pi * half_width)))


def parabola_half_width(depth: float) -> float:
    """Half-width of contact at a depth of the paper's punch."""
    return float(brentq(lambda a: float(parabola_depth(a)) - depth, 0, 0.4999, xtol=1e-15))


def grid_error(points: int, half_width: float, steepness: float, waves: int = 1) -> float:
    """Bound on the grid's error of a mean pressure.

    `half_width` of contact in periods, `steepness` d pbar/da of the punch, `waves` contacts in a period.
    """
    psi, spacing = np.pi * half_width * waves, waves / points
    return float(GRID * spacing**2 * steepness / waves / math.tan(psi) / -math.log(math.sin(psi)))


def parabola_grid_error(points: int, half_width: float) -> float:
    """Bound on the grid's error of the mean pressure under the paper's punch, for G = 1."""
    return grid_error(points, half_width, E_STAR / (2 * RADIUS) * math.tan(np.pi * half_width))


def solver_error(residual: float, contact_area: float, mean_pressure: float = 1.0) -> float:
    """Bound on the solver's error of the mean pressure under the paper's punch.

    Hertz's p_max = (4/pi) pbar/atilde, and depth d pbar/d(depth) below 1.5 pbar.
    """
    return residual * mean_pressure * (4 / (np.pi * contact_area) + 1.5)
