"""The paper's printed equations, and stacks of layers, in fifty digits."""

import math

import numpy as np
from mpmath import matrix, mp, mpf

from gfmdlayer.body.materials import Material


def modulus(material, s):
    """G(s), Eq. (4)."""
    exact = mp.mpmathify(complex(s))
    branches = zip(material.branch_moduli.tolist(), material.branch_times.tolist(), strict=True)
    return mpf(material.relaxed) + sum(mpf(G) * exact * mpf(t) / (1 + exact * mpf(t)) for G, t in branches)


def relative_error(K, q, body, layer, s=0):
    """Of a stiffness of a layer of modulus G or of a material at s, against -1/M(q) of Eqs. (10) to (12)."""
    # As q d falls, differences of order one come down to (q d)^4.
    with mp.workdps(50 + math.ceil(max(0.0, -4 * math.log10(q * body.thickness)))):
        G = modulus(layer, s) if isinstance(layer, Material) else mp.mpmathify(layer)
        x, nu, nu_bulk = mpf(q) * mpf(body.thickness), mpf(body.poisson), mpf(body.bulk_poisson)
        if body.bulk_modulus == 0:  # the limits of Eq. (12) there and at infinity
            m, n = mpf(1), mpf(1)
        else:
            g = mpf(0) if math.isinf(body.bulk_modulus) else G / mpf(body.bulk_modulus)
            m, n = (g - 1) / (g + 3 - 4 * nu), 1 - 4 * (1 - nu) / (1 + g * (3 - 4 * nu_bulk))
        r = mp.exp(-2 * x)
        S = (1 + 4 * m * x * r - m * n * r**2) / (1 - (m + n + 4 * m * x**2) * r + m * n * r**2)
        return float(abs(mp.mpmathify(complex(K)) * (1 - nu) * S / (q * G) - 1))


def layer_matrix(x, nu):
    """Tractions on (W, U) of the upper and lower face, by their displacements, for q = G = 1."""
    # From the basis psi = exp(-z), exp(z - x): (U, W) = (psi, psi') and (z psi, z psi' - (3 - 4 nu) psi).
    displacement, traction = matrix(4, 4), matrix(4, 4)
    for column, (sign, kind) in enumerate(((-1, 0), (-1, 1), (1, 0), (1, 1))):
        for row, z in ((0, mpf(0)), (2, x)):
            psi = mp.exp(sign * z - (x if sign > 0 else 0))
            slope, outward = sign * psi, -1 if row == 0 else 1
            if kind == 0:
                W, U, normal, shear = slope, psi, 2 * psi, 2 * slope
            else:
                W, U = z * slope - (3 - 4 * nu) * psi, z * psi
                normal = 2 * (-2 * (1 - nu) * slope + z * psi)
                shear = (4 * nu - 2) * psi + 2 * z * slope
            displacement[row, column], displacement[row + 1, column] = W, U
            traction[row, column], traction[row + 1, column] = outward * normal, outward * shear
    return traction * displacement**-1


def surface_stiffness(body, q, s, *, shear=True):
    """K(q, s) over (W, U), or over W without shear traction, by elimination from the base upwards."""
    depths = [mpf(q) * mpf(layer.thickness) for layer in body.layers if math.isfinite(layer.thickness)]
    thinnest, thickest = min(depths), min(max(depths), mpf(400))
    # As many digits as leave fifty.
    with mp.workdps(60 + int(thickest) + 8 * len(depths) * math.ceil(max(0.0, -float(mp.log10(thinnest))))):
        impedance = None if body.rigid else matrix(2, 2)
        for layer in reversed(body.layers):
            nu, G = mpf(layer.poisson), modulus(layer.material, s)
            x = mpf(q) * mpf(layer.thickness)
            if x > 400:  # exp(-400) of the rest is below rounding
                c = 3 - 4 * nu
                impedance = G / c * matrix([[4 * (1 - nu), 4 * nu - 2], [4 * nu - 2, 4 * (1 - nu)]])
                continue
            M = layer_matrix(x, nu) * G
            impedance = (
                M[:2, :2]
                if impedance is None
                else M[:2, :2] - M[:2, 2:] * (M[2:, 2:] + impedance) ** -1 * M[2:, :2]
            )
        K = mpf(q) * impedance
        if shear:
            return np.array(K.tolist()).astype(complex)
        return complex(K[0, 0] - K[0, 1] * K[1, 0] / K[1, 1])
