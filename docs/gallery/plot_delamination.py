"""
Where a hard film on rubber delaminates
=======================================

A cylinder is pressed into a hard film on rubber and withdrawn. Peel stress opens the bond, shear stress
slides it. Under load the film is bent: the shear stress is largest beside the contact, and the bond is pulled
a little away from it. When the cylinder leaves, the rubber has relaxed and stays behind, and the film pulls
at it below the former contact: the peel stress is then the largest. A film of intermediate thickness is
loaded the most: a thin one follows the rubber, a thick one spreads the load.
"""

import matplotlib.pyplot as plt
import numpy as np

import gfmdlayer

THICKNESS = np.geomspace(0.002, 0.1, 9)
CONFIG = {
    "grid": {"points": 512},
    "layer": {"poisson": 0.35, "material": {"model": "elastic", "G": 30.0}},
    "halfspace": {"poisson": 0.5, "material": {"model": "zener", "G0": 1.0, "Ginf": 5.0, "tau": 1.0}},
    "punch": {"shape": "parabola", "radius": 0.25},
    "trajectory": {
        "kind": "approach_retract",
        "depth": 0.01,
        "approach_speed": 0.1,
        "dwell": 3.0,
        "retract_speed": 0.1,
    },
    "time": {"step": "adaptive", "end": 3.2},
    "output": {"snapshots": [0.1, 3.1, 3.2], "inside": {"points": 12, "every": 1}},
}
cases = [gfmdlayer.run(CONFIG, layer__thickness=float(d)) for d in THICKNESS]

figure, (peel, shear) = plt.subplots(1, 2, figsize=(9, 3.6), layout="constrained", sharex=True)
for axes, name, words in ((peel, "interface_peel", "peel"), (shear, "interface_shear", "shear")):
    for time, when in ((0.1, "pressed"), (3.1, "held for 3 τ"), (3.2, "withdrawn")):
        values = [case[name].sel(time=time, method="nearest").item() for case in cases]
        axes.semilogx(THICKNESS, values, "o-", label=when)
    axes.set(xlabel="thickness of the film d/L", ylabel=f"largest {words} stress at the bond / G0")
peel.legend(frameon=False)

# %%
# The peel stress over the bond of one film, and the stress along the film, which cracks it.

film = cases[4]
figure, (bond, along) = plt.subplots(1, 2, figsize=(9, 3.6), layout="constrained")
below = gfmdlayer.inside(film, [0.0, float(THICKNESS[4])])
for k, when in enumerate(("pressed", "held for 3 τ", "withdrawn")):
    bond.plot(below.x, below.stress_zz.isel(snapshot=k, z=1), label=when)
    along.plot(below.x, below.stress_xx.isel(snapshot=k, z=1), label=when)
bond.set(xlabel="x/L", ylabel="stress across the bond / G0", xlim=(-0.3, 0.3))
along.set(xlabel="x/L", ylabel="stress along the film above the bond / G0", xlim=(-0.3, 0.3))
bond.legend(frameon=False)
