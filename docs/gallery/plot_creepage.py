"""
A belt that creeps over a pulley
================================

A pulley rolls on a belt with a viscoelastic cover. A force along the belt needs a creepage, a small
difference of speeds: a part of the contact slips, behind the part that sticks, until all of it slides. A
faster belt has a stiffer cover, and creeps less. On a layer some force remains without creepage.
"""

import matplotlib.pyplot as plt

import gfmdlayer

CREEPAGES, WAY = [0.001, 0.003, 0.01, 0.03, 0.1], 104 / 256
figure, (curves, profiles) = plt.subplots(1, 2, figsize=(9, 3.6), layout="constrained")
for speed, colour in ((0.05, "C0"), (1.0, "C3")):
    data = gfmdlayer.run(
        {
            "grid": {"points": 256},
            "layer": {"thickness": 0.05, "poisson": 0.48, "material": {"G0": 1.0, "Ginf": 5.0, "tau": 0.1}},
            "halfspace": {"shear_modulus": 20.0, "poisson": 0.3},
            "punch": {"shape": "cylinder", "radius": 0.5},
            "interface": {"law": "coulomb", "coefficient": 0.3},
            "trajectory": {
                "control": "load",
                "load": 0.05,
                "ramp_time": 0.1 * WAY / speed,
                "velocity": speed,
            },
            "time": {"step": 1 / 256 / speed, "end": WAY / speed},  # by a grid point a step
            "output": {"snapshots": [WAY / speed]},
            "sweep": {"trajectory.creepage": CREEPAGES},
        }
    )
    force = data.interface_friction.isel(time=-1) / 0.3
    curves.semilogx([100 * xi for xi in CREEPAGES], force, "o-", color=colour, label=f"{speed:g}")
    for k, style in ((1, "-"), (3, "--")):
        one = data.isel(creepage=k, snapshot=0)
        label = f"{100 * CREEPAGES[k]:g} %" if speed < 1 else None
        profiles.plot(one.x, one.shear_x / one.pressure.max(), style, color=colour, label=label)
curves.set(xlabel="creepage in %", ylabel="tangential force / (μ P)", ylim=(0, 1.05))
curves.legend(title="speed in L/(10 τ)", frameon=False)
profiles.set(xlim=(-0.12, 0.12), xlabel="x / L", ylabel="shear traction / largest pressure")
profiles.legend(title="creepage", frameon=False)
plt.show()
