"""A flat punch on an elastic layer that is bonded to another elastic material, against published values."""

from __future__ import annotations

import numpy as np
import pytest

from gfmdlayer import Elastic, FlatPunch, Layer, LayerStack, indent


@pytest.mark.parametrize(
    ("modulus", "radius", "stiffening"),
    [(10, 0.5, 1.7281), (10, 1, 2.7278), (10, 2, 4.4881), (2, 0.5, 1.2450), (2, 1, 1.4163), (2, 2, 1.5311)],
)
def test_a_flat_punch_on_a_layer_is_stiffer_by_the_tabulated_factor(
    modulus: float, radius: float, stiffening: float
) -> None:
    # Force over 4 G a depth/(1 - nu), that on a halfspace of the layer's material; thickness 1, nu = 1/2 on
    # nu = 0.3. The table is rounded to 5e-5; 1e-5 is left for the quadrature.
    body = LayerStack((Layer(1.0, 0.5, Elastic(1.0)), Layer(np.inf, 0.3, Elastic(float(modulus)))))
    depth = 0.01
    found = indent(body, FlatPunch(radius=radius), np.array([0.0, 1.0]), depth=np.array([0.0, depth]))
    assert float(found["force"][-1]) / (4 * radius * depth / 0.5) == pytest.approx(stiffening, abs=6e-5)
