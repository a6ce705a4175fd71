"""
7. A sphere creeps into rubber
==============================

A ball with a radius of 5 mm rests with 1 N on a thick rubber sheet, G = 5 MPa at first and 1 MPa at last.

*In another way.* As the contact grows, the elastic solution holds with J(t) = 1/G0 - (1/G0 - 1/Ginf)
exp(-t/θ), θ = τ Ginf/G0, in place of 1/G (Lee and Radok), and a rigid ball is Sneddon's, with F = ((a² +
R²) ln((R + a)/(R - a)) - 2 a R)/(J (1 - ν)) and the depth a/2 ln((R + a)/(R - a)). The rows of a run are
right to a thousandth.
"""

import matplotlib.pyplot as plt
import numpy as np
from scipy.optimize import brentq

import gfmdlayer

radius, force, relaxed, glassy, tau = 5.0, 1.0, 1.0, 5.0, 2.0
data = gfmdlayer.run(
    {
        "units": {"length": "mm", "stress": "MPa", "time": "s"},
        "grid": {"geometry": "axisymmetric"},
        "layer": {
            "thickness": float("inf"),
            "poisson": 0.5,
            "material": {"G0": relaxed, "Ginf": glassy, "tau": tau},
        },
        "punch": {"shape": "sphere", "radius": radius},
        "trajectory": {"control": "force", "force": force, "ramp_time": 0.01},
        "time": {"end": 100.0},
    }
)


def depth(t):
    """Return Sneddon's depth under the force, t after it."""
    J = 1 / relaxed - (1 / relaxed - 1 / glassy) * np.exp(-t * relaxed / glassy / tau)
    logarithm = lambda a: np.log((radius + a) / (radius - a))  # noqa: E731
    load = lambda a: 2 * ((a**2 + radius**2) * logarithm(a) - 2 * a * radius) / J  # noqa: E731
    a = brentq(lambda a: load(a) - force, 1e-6, radius / 2)
    return a / 2 * logarithm(a)


found, expected, within = float(data.depth[-1]), depth(100.0), 1e-3
assert abs(found / expected - 1) < within
print(f"depth after 100 s: {found:.5f} mm; by Sneddon, Lee and Radok {expected:.5f} mm")

times = np.geomspace(0.02, 100.0, 14)
figure, panel = plt.subplots(figsize=(5.6, 3.4), layout="constrained")
panel.semilogx(data.time[1:], data.depth[1:], "C0", label="run")
panel.semilogx(times, [depth(t - 0.005) for t in times], "k+", label="Sneddon, Lee and Radok")
panel.set(xlabel="time [s]", ylabel="depth [mm]", xlim=(1e-3, 100), ylim=(0, 0.2))
panel.legend(frameon=False)
plt.show()
