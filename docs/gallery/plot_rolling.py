"""
Rolling friction of a cylinder
==============================

A cylinder rolls over a viscoelastic layer under a given load. The pressure leans forward, and the contact resists, most
where a point passes through the contact in a relaxation time. Slow and fast rolling are nearly free of friction.
"""

import matplotlib.pyplot as plt
import numpy as np

import gfmdlayer

speeds = np.geomspace(0.003, 100.0, 14)
sweep = gfmdlayer.run(
    {
        "grid": {"points": 256},
        "layer": {"thickness": 0.1},
        "punch": {"shape": "cylinder", "radius": 0.5},
        "trajectory": {"control": "load", "load": 0.02, "ramp_time": 1.0, "velocity": 0.1},
        "time": {"end": 500.0, "step": "adaptive", "tolerance": 1e-3, "steady": 1e-3},
        "sweep": {"trajectory.velocity": list(speeds)},
    }
)
friction = sweep.friction.isel(time=-1)

fast = gfmdlayer.run(
    {
        "grid": {"points": 1024},
        "layer": {"thickness": 0.1},
        "punch": {"shape": "cylinder", "radius": 0.5},
        "trajectory": {"control": "load", "load": 0.02, "ramp_time": 1.0, "velocity": 0.1},
        "time": {"end": 20.0, "step": "adaptive", "tolerance": 1e-3},
        "output": {"snapshots": [20.0]},
    }
).isel(snapshot=-1)

figure, (left, right) = plt.subplots(1, 2, figsize=(8.4, 3.3), layout="constrained")
left.semilogx(speeds, friction, "o-")
left.set(xlabel="speed / (L/τ)", ylabel="coefficient of friction")
right.fill_between(fast.x, fast.pressure, alpha=0.4)
right.plot(fast.x, fast.pressure)
right.set(xlabel="x / L, in the frame of the cylinder", ylabel="pressure / G0", xlim=(-0.25, 0.25))
right.annotate("rolling", (0.2, 0.9), (0.05, 0.9), xycoords="axes fraction", arrowprops={"arrowstyle": "->"})
plt.show()
