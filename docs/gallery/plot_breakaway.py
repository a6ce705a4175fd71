"""
Break-away of rough rubber after a dwell
========================================

A rough surface rests on a rubber that creeps, and is then pulled along it. The contacts have a shear
strength: the force that they carry is proportional to the real area of contact, which has grown while the
surface rested. The longer the dwell, the stiffer is the contact, and the larger the force at which it
breaks away.
"""

import math

import matplotlib.pyplot as plt

import gfmdlayer

STRENGTH, LOAD = 0.1, 0.02
figure, (pulls, growth) = plt.subplots(1, 2, figsize=(9, 3.6), layout="constrained")
for dwell in (0.1, 1.0, 10.0):
    start = 0.1 + dwell
    data = gfmdlayer.run(
        {
            "grid": {"points": [64, 64]},
            "layer": {
                "thickness": math.inf,
                "poisson": 0.5,
                "material": {"G0": 1.0, "Ginf": 10.0, "tau": 1.0},
            },
            "punch": {
                "shape": "self_affine",
                "hurst": 0.8,
                "roll_off": 0.25,
                "short_cutoff": 0.06,
                "rms_slope": 0.1,
                "seed": 2,
            },
            "interface": {"law": "shear_strength", "stress": STRENGTH},
            "trajectory": {
                "control": "load",
                "load": LOAD,
                "ramp_time": 0.1,
                "tangential": {"displacement": 0.0004, "start": start, "ramp_time": 0.2},
            },
            "time": {"step": "adaptive", "tolerance": 1e-3, "end": start + 0.2},
            "output": {"snapshots": [start]},
        }
    )
    pulled = data.sel(time=slice(start, None))
    pulls.plot(1e4 * pulled.tangential_displacement, pulled.friction, "o-", markersize=3, label=f"{dwell:g}")
    growth.semilogx(dwell, float(data.contact_area.sel(time=start, method="nearest")), "ko")
pulls.set(xlabel="displacement along the surface, in L/10000", ylabel="tangential force / normal force")
pulls.legend(title="dwell / τ", frameon=False)
growth.set(xlabel="dwell / τ", ylabel="real area of contact", ylim=(0, None))
plt.show()
