"""
Maps of thickness and modulus
=============================

How much does the pressure relax in a hold? On a thick layer it falls almost to the ratio of the layer's
moduli. On a thin layer with a soft base it hardly changes, because the base carries the punch. In between
the contact grows while the layer relaxes, most on soft bases. Each point of the maps is one run.
"""

import matplotlib.pyplot as plt
import numpy as np

import gfmdlayer

thickness = np.geomspace(0.01, 1.0, 9)
base = np.geomspace(0.1, 1000.0, 9)
sweep = gfmdlayer.run(
    {
        "grid": {"points": 1024},
        "time": {"end": 40.0, "step": "adaptive", "tolerance": 1e-3},
        "output": {"times": [1.0, 40.0]},
        "sweep": {"layer.thickness": list(thickness), "halfspace.shear_modulus": list(base)},
    }
)

pressure = sweep.mean_pressure
kept = (pressure.sel(time=40.0) / pressure.sel(time=1.0)).transpose("shear_modulus", "thickness")
grown = sweep.contact_area_interpolated
grown = (grown.sel(time=40.0) / grown.sel(time=1.0)).transpose("shear_modulus", "thickness")

figure, panels = plt.subplots(1, 2, figsize=(8.4, 3.4), sharey=True, layout="constrained")
for panel, values, label in zip(panels, (kept, grown), ("mean pressure", "contact area"), strict=True):
    mesh = panel.pcolormesh(thickness, base, values, shading="gouraud", cmap="viridis")
    panel.set(xscale="log", yscale="log", xlabel="thickness / L")
    panel.set_title(label, fontsize=10)
    figure.colorbar(mesh, ax=panel, label="at 40 τ, over that at τ")
panels[0].set_ylabel("modulus of the base / $G_0$")
plt.show()
