"""
Moduli of a gel from a force curve
==================================

The sphere of a cantilever is pressed into a gel of 2 µm on glass, held and withdrawn. The force
determines the gel's relaxed and instantaneous moduli and its relaxation time; the model contains the
glass exactly. The band is the uncertainty due to 5 % noise.
"""

import matplotlib.pyplot as plt
import numpy as np

import gfmdlayer

rng = np.random.default_rng(1)
time = np.linspace(0.0, 6.0, 61)
depth = 400.0 * np.interp(time, [0.0, 0.5, 4.5, 6.0], [0.0, 1.0, 1.0, -0.2])
truth = gfmdlayer.bonded_layer(thickness=2000.0, material=gfmdlayer.Zener(G0=1e-6, Ginf=3e-6, tau=0.8))
exact = gfmdlayer.indent(truth, gfmdlayer.Sphere(radius=5000.0), time, depth=depth)
force = np.interp(time, exact.time, exact.force)
measured = force + 0.05 * force.max() * rng.standard_normal(force.size)

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
(found,) = fit.curves

figure, (left, right) = plt.subplots(1, 2, figsize=(8.6, 3.4), layout="constrained", width_ratios=(1.5, 1))
left.plot(time, measured, ".", ms=4, color="0.5", label="measured")
left.plot(time, found.force, "C1", lw=1, label="fit, with its 95 % band")
left.fill_between(time, found.force - found.band, found.force + found.band, color="C1", alpha=0.4, lw=0)
left.set(xlabel="time [s]", ylabel="force [nN]")
left.legend()
for row, (key, true) in enumerate(zip(("G0", "Ginf", "tau"), (1e-6, 3e-6, 0.8), strict=True)):
    estimate = fit[key]
    low, high = (edge / true for edge in estimate.interval)
    right.plot([low, high], [row, row], "C1", lw=4, alpha=0.5)
    right.plot(estimate.value / true, row, "C1o")
right.axvline(1, color="0.7", lw=0.8)
right.set(
    yticks=range(3),
    yticklabels=["$G_0$", r"$G_\infty$", "τ"],
    xlabel="estimate / truth, with its 95 % interval",
)
plt.show()
