"""
One contact, not a lattice of them
==================================

A sphere presses into a viscoelastic layer on a soft base, holds and retracts. In a periodic cell the
neighbouring spheres press too, and the force is far too large, also in a wide cell. With
``boundary: isolated`` a cell of five contact radii has the force of one sphere, which `gfmdlayer.indent`
finds by another method. The punch need not be round: on the right the pressure of a blunt square pyramid.
"""

import matplotlib.pyplot as plt
import numpy as np

import gfmdlayer

body = gfmdlayer.bonded_layer(0.1, gfmdlayer.Zener(G0=1.0, Ginf=10.0, tau=1.0), poisson=0.45, halfspace=5.0)
exact = gfmdlayer.indent(body, gfmdlayer.Parabola(radius=1.0), [0, 1, 4, 5], depth=[0, 0.01, 0.01, 0])
radius = float(exact.contact_radius.max())

zener = {"model": "zener", "G0": 1.0, "Ginf": 10.0, "tau": 1.0}
config = {
    "layer": {"thickness": 0.1, "poisson": 0.45, "material": zener},
    "halfspace": {"shear_modulus": 5.0},
    "punch": {"shape": "parabola", "radius": 1.0},
    "trajectory": {"kind": "approach_retract", "start": 0.0, "depth": 0.01, "approach_speed": 0.01,
                   "dwell": 3.0, "retract_speed": 0.01, "final": 0.0},
    "time": {"step": "adaptive"},
}  # fmt: skip
cells = {"periodic": 5, "periodic, twice as wide": 10, "isolated": 5}
runs = {
    name: gfmdlayer.run(
        config,
        grid={
            "points": [64 * width // 5, 64 * width // 5],
            "period": width * radius,
            "boundary": name.partition(",")[0],
        },
    )
    for name, width in cells.items()
}
pyramid = gfmdlayer.solve(
    body,
    lambda x, y: -np.sqrt((np.maximum(np.abs(x), np.abs(y)) / 3) ** 2 + 0.01**2),
    depth=0.02,
    period=0.6,
    points=(128, 128),
    isolated=True,
)

figure, (left, right) = plt.subplots(1, 2, figsize=(8.4, 3.4), layout="constrained")
for (name, run), style in zip(runs.items(), ("C1:", "C1--", "C0-"), strict=True):
    left.plot(run.time, run.force * 1e3, style, label=name)
left.plot(exact.time[::6], exact.force[::6] * 1e3, "ko", ms=3, label="one sphere, by indent")
left.set(xlabel="time / τ", ylabel="force / $10^{-3} G_0 L^2$", ylim=(-3, 75))
left.legend(frameon=False)
image = right.pcolormesh(pyramid.x, pyramid.y, pyramid.pressure.T, cmap="viridis", rasterized=True)
right.set(xlabel="x / L", ylabel="y / L", aspect="equal", xlim=(-0.15, 0.15), ylim=(-0.15, 0.15))
right.set_xticks([-0.1, 0, 0.1])
figure.colorbar(image, ax=right, label="pressure / $G_0$")
plt.show()
