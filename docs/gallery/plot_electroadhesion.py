"""
An electroadhesive finger pad that grips late
=============================================

The pad of a gripper's finger is a soft film on a stiff electrode. It stops 8 µm in front of a slightly
wavy conductor; then a voltage is switched on. At first the film is stiff and resists the attraction.
While the film relaxes, its surface rises until there is no equilibrium, and its summit snaps to the
conductor: the pad grips more than a second after the voltage.
"""

import matplotlib.pyplot as plt
import numpy as np

import gfmdlayer

film = gfmdlayer.run(
    {
        "units": {"length": "m", "stress": "Pa", "time": "s"},
        "grid": {"points": 1024, "period": 2.5e-4},
        "layer": {"thickness": 1e-4, "poisson": 0.45, "material": {"G0": 2e4, "Ginf": 2e5, "tau": 0.5}},
        "halfspace": {"shear_modulus": float("inf")},
        "punch": {"shape": "sinusoid", "amplitude": 1e-6, "wavelength": 2.5e-4},
        "interface": {
            "law": "electrostatic",
            "voltage": np.array([[0.0, 0.0], [0.1, 0.0], [0.11, 600.0], [10.0, 600.0]]),
            "insulation": [{"thickness": 1e-5, "permittivity": 3.0}],
        },
        "trajectory": {
            "kind": "approach_retract",
            "start": -1.2e-5,
            "depth": -8e-6,
            "approach_speed": 1e-4,
            "dwell": 6.0,
        },
        "time": {"step": "adaptive", "tolerance": 1e-3},
        "output": {"snapshots": [0.05, 0.5, 1.5, 5.0]},
    }
)

figure, (left, right) = plt.subplots(1, 2, figsize=(8.6, 3.4), layout="constrained")
left.plot(film.time, -film.force)
left.set(xlabel="time [s]", ylabel="attraction per length [N/m]", xlim=(0, 6), ylim=(0, 9))
for time in film.attrs["instability_time"][:1]:
    left.axvline(time, color="0.6", ls=":")
    left.text(time - 0.1, 0.3, "snap", ha="right")
x = 1e6 * film.x
for shot, colour in zip(film.snapshot.values, plt.cm.viridis(np.linspace(0, 0.9, 4)), strict=True):
    right.plot(x, 1e6 * film.displacement.sel(snapshot=shot), color=colour, label=f"{shot:g} s")
electrode = (film.displacement + film.gap).isel(snapshot=-1)
right.plot(x, 1e6 * electrode, "k--", lw=1, label="conductor")
right.set(xlabel="x [µm]", ylabel="height of the film [µm]", ylim=(-0.5, 13.5))
right.legend(fontsize=8, ncols=3, loc="upper center")
plt.show()
