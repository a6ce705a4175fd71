"""
The paper's Figure 2
====================

A parabola is pressed into layers of several thicknesses and held. The base is as stiff as the layer's
glassy modulus. Without a layer, and for an infinitely thick layer, the contact area stays constant in the
hold. For all other thicknesses the layer relaxes and the base does not, and the contact grows.
"""

import matplotlib.pyplot as plt
import numpy as np

import gfmdlayer

sweep = gfmdlayer.run(
    {
        "grid": {"points": 2048},
        "halfspace": {"shear_modulus": 10.0},
        "time": {"end": 8.0, "step": "adaptive", "tolerance": 1e-4},
        "sweep": {"layer.thickness": [0, 1 / 32, 1 / 16, 1 / 8, 1 / 4, float("inf")]},
    }
)

figure, panels = plt.subplots(1, 2, figsize=(8, 3.4), layout="constrained")
labels = ["0", "1/32", "1/16", "1/8", "1/4", "∞"]
for thickness, label, colour in zip(
    sweep.thickness, labels, plt.cm.viridis(np.linspace(0, 0.9, 6)), strict=True
):
    case = sweep.sel(thickness=thickness)
    style = {"color": colour, "linestyle": "--" if label == "∞" else "-"}
    panels[0].plot(case.time, case.contact_area_interpolated, label=f"d/L = {label}", **style)
    panels[1].plot(case.time, case.mean_pressure, **style)
panels[0].set(xlabel="t/τ", ylabel="relative contact area")
panels[1].set(xlabel="t/τ", ylabel="mean pressure / 2 $G_0$")
panels[0].legend()
plt.show()
