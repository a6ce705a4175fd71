"""
Pulled off slowly and fast
==========================

A ridge is pressed into an adhesive viscoelastic layer, waits until the layer has relaxed, and is pulled
off. During a slow pull the layer is relaxed. During faster pulls the layer is stiff around the opening
edge: the force is several times larger, and most of the work turns into heat. The strength of the
interface limits the fastest pull, and the surfaces separate earlier.
"""

import matplotlib.pyplot as plt
import numpy as np

import gfmdlayer

speeds = [1e-5, 1e-3, 1e-2, 0.1, 1.0, 100.0]
pad = {
    "units": {"length": "mm", "stress": "MPa", "time": "s"},
    "grid": {"points": 1024, "period": 10.0},
    "layer": {"thickness": 2.0, "poisson": 0.49, "material": {"G0": 0.2, "Ginf": 2.0, "tau": 1.0}},
    "halfspace": {"shear_modulus": float("inf")},
    "punch": {"shape": "parabola", "radius": 10.0},
    "interface": {"law": "exponential", "work": 2.0e-4, "range": 0.01},
    "trajectory": {
        "kind": "approach_retract",
        "start": 0.0,
        "depth": 0.1,
        "approach_speed": 0.1,
        "dwell": 20.0,
        "retract_speed": 0.1,
        "final": -0.5,
    },
    "time": {"step": "adaptive", "tolerance": 3e-4},
}
cases = [gfmdlayer.run(pad, trajectory__retract_speed=speed) for speed in speeds]

figure, (left, right) = plt.subplots(1, 2, figsize=(8.6, 3.4), layout="constrained")
for speed, case, colour in zip(speeds, cases, plt.cm.plasma(np.linspace(0, 0.85, len(speeds))), strict=True):
    left.plot(case.depth, 1e3 * case.force, color=colour, label=f"{speed:g} mm/s")
left.axhline(0, color="0.7", lw=0.8)
left.set(xlabel="depth [mm]", ylabel="force per length [N/m]", xlim=(-0.08, 0.1), ylim=(-45, 30))
left.set_xticks([-0.05, 0.0, 0.05, 0.1])
left.legend(fontsize=8, title="retraction")
right.loglog(speeds, [1e3 * case.attrs["pull_off_force"] for case in cases], "o-", label="pull-off [N/m]")
work = [1e6 * case.attrs["work_of_separation"] for case in cases]
right.loglog(speeds, work, "s--", label="work of separation [J/m²]")
right.set(xlabel="speed of the retraction [mm/s]", ylabel="pull-off, work")
right.set_yticks([10, 20, 50, 100], ["10", "20", "50", "100"])
right.minorticks_off()
right.legend(fontsize=8)
plt.show()
