"""
Resistance and stiffness of a creeping contact
==============================================

A sphere sinks into a viscoelastic body under a constant force. The modulus falls tenfold, but the resistance
follows the contact area, with no memory of its own: ρ/(2a) of a disc, less the effect of its periodic images.
The dynamic stiffness at a frequency f is larger than the relaxed one and grows with the contact.
"""

import matplotlib.pyplot as plt
import numpy as np

import gfmdlayer

data = gfmdlayer.run(
    {
        "grid": {"points": [128, 128]},
        "layer": {"thickness": float("inf")},
        "punch": {"shape": "parabola", "radius": 2.0},
        "trajectory": {"control": "force", "force": 0.01, "ramp_time": 0.01},
        "time": {"end": 20.0, "step": "adaptive", "tolerance": 3e-3},
        "output": {
            "conductance": {"body": {"resistivity": 1.0}, "punch": {"resistivity": 1.0}},
            "stiffness": {"frequencies": [0.0, 0.1, 0.3, 1.0]},
        },
    }
).isel(time=slice(1, None))
a = np.sqrt(data.contact_area_interpolated / np.pi)
images = 3.9003 / np.pi  # of the square cell, for two bodies of resistivity 1

figure, (left, right) = plt.subplots(1, 2, figsize=(8.6, 3.4), layout="constrained")
left.semilogx(data.time, data.resistance, "o", markersize=4, label="computed")
left.semilogx(data.time, 1 / (2 * a) - images, label="1/(2a), less images")
left.set(xlabel="t/τ", ylabel="resistance / (ρ/L)", ylim=(0, None))
left.legend(frameon=False)
for k, frequency in enumerate(data.frequency.values):
    right.semilogx(data.time, data.storage_stiffness[:, k], label=f"f τ = {frequency:g}")
right.set(xlabel="t/τ", ylabel="storage stiffness / (G0 L)", ylim=(0, None))
right.legend(frameon=False, ncols=2)
plt.show()
