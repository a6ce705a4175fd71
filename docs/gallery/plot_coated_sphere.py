"""
A steel sphere on a rubber coating, in SI units
===============================================

A sphere of 10 mm in diameter is pressed 8 µm deep into 200 µm of rubber on steel, within a tenth of a
second. The rubber cannot move sideways: the force is five times the force on solid rubber. The periodic
computation agrees with the computation of an isolated sphere.
"""

import matplotlib.pyplot as plt

import gfmdlayer

rubber = gfmdlayer.Zener(G0=1.0e6, Ginf=5.0e6, tau=0.1)
coated = gfmdlayer.run(
    {
        "units": {"length": "m", "stress": "Pa", "time": "s"},
        "grid": {"points": [96, 96], "period": 2.0e-3},
        "layer": {"thickness": 2.0e-4, "material": {"G0": 1.0e6, "Ginf": 5.0e6, "tau": 0.1}},
        "halfspace": {"shear_modulus": 8.0e10, "poisson": 0.3},
        "punch": {"shape": "sphere", "radius": 5.0e-3},
        "trajectory": {"depth": 8.0e-6, "ramp_time": 0.1},
        "time": {"end": 1.0, "step": "adaptive", "tolerance": 1e-3},
        "output": {"snapshots": [1.0], "times": 0.02},
    }
)
body = gfmdlayer.bonded_layer(thickness=2.0e-4, material=rubber)
isolated = gfmdlayer.indent(body, gfmdlayer.Sphere(radius=5.0e-3), [0.0, 0.1, 1.0], depth=[0.0, 8e-6, 8e-6])

figure, (left, right) = plt.subplots(1, 2, figsize=(8.4, 3.4), layout="constrained", width_ratios=(1.2, 1))
left.plot(coated.time, 1e3 * coated.force, label="periodic, 96 × 96 points")
left.plot(isolated.time, 1e3 * isolated.force, "--", label="isolated sphere")
left.set(xlabel="time [s]", ylabel="force [mN]", ylim=(0, None))
left.legend()
pressure = coated.pressure.isel(snapshot=-1) / 1e3
image = right.imshow(pressure.where(pressure > 0).T, origin="lower", extent=(-1, 1, -1, 1), cmap="inferno")
right.set(xlim=(-0.5, 0.5), ylim=(-0.5, 0.5), xlabel="x [mm]", ylabel="y [mm]", facecolor="0.93")
figure.colorbar(image, ax=right, label="pressure [kPa]")
plt.show()
