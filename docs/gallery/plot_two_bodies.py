"""
A coated ball on a coated plate
===============================

A ball with a soft coating is pressed on a plate with another one, and held. Both coatings relax, the one of
the ball twenty times as fast. The energies of each body show where the work of the contact is; the snapshots
show the deformation of each. On the right, a cylinder
with the same coatings rolls on the plate. Each coating dissipates most at a velocity of its own; the one of
the faster coating is some thirty times as high.
"""

import matplotlib.pyplot as plt
import numpy as np

import gfmdlayer

plate = {"thickness": 0.05, "material": {"model": "zener", "G0": 1.0, "Ginf": 10.0, "tau": 1.0}}
ball = {"thickness": 0.03, "material": {"model": "zener", "G0": 2.0, "Ginf": 8.0, "tau": 0.05}}
steel = {"shear_modulus": 1.0e3, "poisson": 0.3}
contact = {
    "grid": {"points": [96, 96]},
    "layer": plate,
    "halfspace": steel,
    "counterbody": {"layer": ball, "halfspace": steel},
    "punch": {"shape": "parabola", "radius": 0.25},
    "trajectory": {"control": "load", "load": 0.01, "ramp_time": 0.05},
    "time": {"end": 20.0, "step": "adaptive"},
    "output": {"snapshots": [0.05, 20.0]},
}
names = {"body": "plate", "counterbody": "ball"}

figure, (energies, surfaces, heat) = plt.subplots(1, 3, figsize=(12, 3.6), layout="constrained")
data = gfmdlayer.run(contact)
middle = data.sizes["y"] // 2
for (body, name), colour in zip(names.items(), ("C0", "C1"), strict=True):
    energies.semilogx(data.time[1:], 1e4 * data[f"stored_{body}"][1:], colour, label=f"{name}, stored")
    energies.semilogx(
        data.time[1:], 1e4 * data[f"dissipated_{body}"][1:], f"{colour}--", label=f"{name}, heat"
    )
    for index, style in enumerate(("-", ":")):
        u = data[f"displacement_{body}"][index, :, middle]
        surfaces.plot(
            data.x, 100 * u, colour, ls=style, label=f"{name}, t = {float(data.snapshot[index]):g} τ"
        )
energies.set(xlabel="time / τ", ylabel="energy / (10⁻⁴ G₀ L)", xlim=(1e-3, 20))
energies.legend(frameon=False, fontsize=8)
surfaces.set(xlabel="x / L", ylabel="displacement / (10⁻² L)", xlim=(-0.25, 0.25))
surfaces.legend(frameon=False, fontsize=8)

speeds = np.geomspace(1e-3, 10.0, 17)
rates = []
for speed in speeds:
    rolling = gfmdlayer.run(
        contact,
        grid={"points": 1024},
        counterbody=contact["counterbody"] | {"velocity_ratio": 1.0},
        trajectory=contact["trajectory"] | {"load": 0.05, "velocity": float(speed)},
        time={"end": 10.0 + 0.4 / float(speed), "step": "adaptive"},
        output={},
    )
    time, load = rolling.time[-2:], float(rolling.mean_stress[-1])
    gained = [float(np.diff(rolling[f"dissipated_{body}"][-2:])[0]) for body in names]
    rates.append(np.array(gained) / (float(speed) * float(np.diff(time)[0]) * load))
for column, (name, colour) in enumerate(zip(names.values(), ("C0", "C1"), strict=True)):
    heat.semilogx(speeds, np.array(rates)[:, column], colour, label=f"heat in the {name}")
heat.semilogx(speeds, np.sum(rates, axis=1), "k", lw=0.8, label="rolling friction")
heat.set(xlabel="velocity / (L/τ)", ylabel="heat per distance and load")
heat.legend(frameon=False, fontsize=8)
plt.show()
