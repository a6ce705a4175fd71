"""
6. Stresses at a bond
=====================

A rubber sheet of 1 mm, bonded to steel, under a roller with a radius of 400 mm. Cracks begin where the bond
is sheared most, and that is inside of the contact, not at its edge.

*In another way.* In a thin incompressible sheet the pressure squeezes the rubber like a film of fluid whose
upper face slips: p = G (a² - x²)²/(8 R h³) over a contact of the half-width a, a load of 2 G a⁵/(15 R h³)
per length, and the shear h dp/dx at the bond. Its largest value is G a³/(3 √3 R h²). What this leaves out
is of second order in h/a, here 1/400, with a factor of some units.
"""

import matplotlib.pyplot as plt
import numpy as np

import gfmdlayer

h, a, radius, relaxed = 1.0, 20.0, 400.0, 1.0  # mm, and MPa
load = 2 * relaxed * a**5 / (15 * radius * h**3)  # N/mm
data = gfmdlayer.run(
    {
        "units": {"length": "mm", "stress": "MPa", "time": "s"},
        "grid": {"points": 512, "period": 8 * a},
        "layer": {"thickness": h, "poisson": 0.5, "material": {"G0": relaxed, "Ginf": 5.0, "tau": 1.0}},
        "halfspace": {"shear_modulus": float("inf")},
        "punch": {"shape": "cylinder", "radius": radius},
        "trajectory": {"control": "force", "force": load, "ramp_time": 1.0},
        "time": {"end": 40.0, "tolerance": 1e-3},
        "output": {"snapshots": [1.0, 40.0], "inside": {"depths": [0.0, 0.5 * h, h]}},
    }
)
bond = data.isel(z=-1)

found, expected = float(abs(bond.stress_xz[-1]).max()), relaxed * a**3 / (3 * 3**0.5 * radius * h**2)
within = 8 * (h / a) ** 2
assert abs(found / expected - 1) < within
print(f"largest shear stress at the bond: {found:.3f} MPa; of a thin sheet {expected:.3f} MPa")

x = np.linspace(-a, a, 41)
figure, panels = plt.subplots(2, 1, figsize=(5.8, 5.0), layout="constrained", sharex=True)
for i, when in enumerate(("1 s", "40 s")):
    panels[0].plot(data.x, data.pressure[i], f"C{i}", label=f"after {when}")
    panels[1].plot(bond.x, bond.stress_xz[i], f"C{i}")
panels[0].plot(x, relaxed * (a**2 - x**2) ** 2 / (8 * radius * h**3), "k:", label="thin sheet, relaxed")
panels[1].plot(x, -relaxed * x * (a**2 - x**2) / (2 * radius * h**2), "k:")
panels[0].set(ylabel="contact pressure [MPa]", xlim=(-1.6 * a, 1.6 * a))
panels[1].set(xlabel="x [mm]", ylabel="shear stress at the bond [MPa]")
panels[0].legend(frameon=False, fontsize=8)
plt.show()
