"""
Fretting of a coated sphere
===========================

A sphere is pressed on a rubber coating and shaken along it. A small displacement slips at the edge only,
and the loop of force over displacement is narrow; a large one slides, and the loop opens. Stick and slip
are drawn on the way back of the middle one.
"""

import matplotlib.pyplot as plt
import numpy as np
from matplotlib.colors import ListedColormap

import gfmdlayer

KEY, AMPLITUDES = "trajectory.tangential.displacement", [0.0006, 0.0018, 0.005]
data = gfmdlayer.run(
    {
        "grid": {"points": [64, 64]},
        "layer": {"thickness": 0.1, "poisson": 0.45, "material": {"G0": 1.0, "Ginf": 3.0, "tau": 1.0}},
        "halfspace": {"shear_modulus": 10.0, "poisson": 0.3},
        "punch": {"shape": "sphere", "radius": 1.0},
        "interface": {"law": "coulomb", "coefficient": 0.4},
        "trajectory": {
            "control": "force",
            "force": 0.01,
            "tangential": {"kind": "oscillation", "displacement": 0.001, "start": 2.0, "period": 1.0},
        },
        "time": {"step": 0.05, "end": 4.0},
        "output": {"snapshots": [3.7]},
        "sweep": {KEY: AMPLITUDES},
    }
)

figure, (loops, spots) = plt.subplots(1, 2, figsize=(9, 3.8), layout="constrained", width_ratios=(1.5, 1))
for amplitude in AMPLITUDES:
    case = data.sel({KEY: amplitude})
    loops.plot(1e3 * case.tangential_displacement, case.friction, label=f"{1e3 * amplitude:g}")
loops.set(xlabel="displacement along the surface, in L/1000", ylabel="tangential force / normal force")
loops.legend(title="amplitude", frameon=False)
middle = data.isel({KEY: 1, "snapshot": 0})
state = np.where(middle.pressure > 0, np.where(middle.slip_velocity_x == 0, 1, 2), 0)
colours = ListedColormap(["white", "#0072b2", "#e69f00"])
spots.imshow(state.T, origin="lower", extent=(-0.5, 0.5, -0.5, 0.5), cmap=colours, vmin=0, vmax=2)
spots.set(
    xlim=(-0.2, 0.2), ylim=(-0.2, 0.2), xlabel="x / L", ylabel="y / L", title="stick (blue), slip (orange)"
)
plt.show()
