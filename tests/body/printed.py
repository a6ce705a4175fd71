"""The paper's printed equations in fifty digits."""

import math

from mpmath import mp, mpf

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
