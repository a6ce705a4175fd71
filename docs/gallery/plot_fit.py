"""
Moduli of a gel from a force curve
==================================

The sphere of a cantilever is pressed into a gel of 2 µm on glass, held and withdrawn. The force tells the gel's relaxed and
instantaneous moduli and its relaxation time, with the glass taken into account exactly; the band is what a noise of 2 %
leaves open.
"""

import matplotlib.pyplot as plt
import numpy as np

import gfmdlayer

rng = np.random.default_rng(1)
time = np.linspace(0.0, 6.0, 241)
depth = 400.0 * np.interp(time, [0.0, 0.5, 4.5, 6.0], [0.0, 1.0, 1.0, -0.2])
truth = gfmdlayer.bonded_layer(thickness=2000.0, material=gfmdlayer.Zener(G0=1e-6, Ginf=3e-6, tau=0.8))
exact = gfmdlayer.indent(truth, gfmdlayer.Sphere(radius=5000.0), time, depth=depth)
force = np.interp(time, exact.time, exact.force)
measured = force + 0.02 * force.max() * rng.standard_normal(force.size)

# Lengths in nm, forces in nN: moduli are in nN/nm², which is GPa.
model = {
    "grid": {"geometry": "axisymmetric"},
    "layer": {"thickness": 2000.0, "material": {"model": "zener", "G0": 2e-6, "Ginf": 2e-6, "tau": 0.3}},
    "halfspace": {"shear_modulus": float("inf")},
    "punch": {"shape": "sphere", "radius": 5000.0},
}
keys = ["layer.material.G0", "layer.material.Ginf", "layer.material.tau"]
curve = gfmdlayer.ForceCurve("gel", time, depth, measured)
fit = gfmdlayer.fit_indentation(curve, model, keys)
print(fit)
