"""
A tip on a crystal
==================

A tip that attracts by a Lennard-Jones law is pressed on the (100) face of an fcc crystal, and on its
continuum. Each point of the grid is a surface atom. The stiffness of the crystal follows the continuum
for long waves only, and differs with the direction.
"""

import matplotlib.pyplot as plt
import numpy as np

import gfmdlayer

POINTS = 48
crystal = {"kind": "lattice", "crystal": "fcc", "nearest": 1.0, "spacing": 1.0}
C11, C12, C44 = gfmdlayer.Lattice(
    **{key: crystal[key] for key in ("crystal", "nearest", "spacing")}
).constants
bodies = {
    "crystal": crystal,
    "continuum": {"kind": "anisotropic", "C11": C11, "C12": C12, "C44": C44, "angle": 45},
}

figure, (curves, maps) = plt.subplots(1, 2, figsize=(9, 3.8), layout="constrained")
for (name, body), style in zip(bodies.items(), ("-", "--"), strict=True):
    data = gfmdlayer.run(
        {
            "grid": {"points": [POINTS, POINTS], "period": float(POINTS)},
            "body": body,
            "punch": {"shape": "parabola", "radius": 2.0},
            "interface": {"law": "lennard_jones", "work": 0.3, "separation": 0.7},
            "trajectory": {"kind": "approach_retract", "start": -2.0, "depth": 1.0, "approach_speed": 1.0},
            "time": {"step": 0.1},
            "output": {"snapshots": [3.0]},
        }
    )
    curves.plot(data.depth, data.force, style, label=name)
curves.set(xlabel="depth, in spacings of atoms", ylabel="force, in spring times spacing")
curves.legend(frameon=False)

q = np.linspace(-np.pi, np.pi, 201)
waves = gfmdlayer.Wavevectors.of_components(q[:, None], q[None, :])
stiffness = gfmdlayer.Lattice(crystal="fcc", nearest=1.0, spacing=1.0).stiffness(waves, 0.0)
image = maps.contourf(q / np.pi, q / np.pi, stiffness.T, 16, cmap="viridis")
maps.set(xlabel="qx b / π", ylabel="qy b / π", aspect="equal")
figure.colorbar(image, ax=maps, label="K b² / k")
plt.show()
