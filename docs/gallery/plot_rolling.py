"""
Rolling friction of a cylinder
==============================

A cylinder rolls over a viscoelastic layer under a given load. The pressure is larger at the front, and
the contact resists the motion. The friction is largest if a point passes through the contact within a
relaxation time. Slow and fast rolling have almost no friction.
"""

import matplotlib.pyplot as plt
import numpy as np

import gfmdlayer

rolling = {
    "grid": {"points": 384},
    "layer": {"thickness": 0.1},
    "punch": {"shape": "cylinder", "radius": 0.5},
    "trajectory": {"control": "load", "load": 0.1, "ramp_time": 1.0},
    "time": {"end": 600.0, "step": "adaptive", "tolerance": 1e-3, "steady": 1e-3},
    "output": {"snapshots": []},
}
speeds = np.geomspace(0.005, 10.0, 12)
friction = [float(gfmdlayer.run(rolling, trajectory__velocity=speed).friction[-1]) for speed in speeds]

slow = gfmdlayer.run(
    rolling,
    trajectory__velocity=0.05,
    time={"end": 20.0, "step": "adaptive", "tolerance": 1e-3},
    output={"snapshots": [20.0]},
).isel(snapshot=-1)

figure, (left, right) = plt.subplots(1, 2, figsize=(8.4, 3.3), layout="constrained")
left.semilogx(speeds, friction, "o-")
left.set(xlabel="speed / (L/τ)", ylabel="coefficient of friction", ylim=(0, None))
right.fill_between(slow.x, slow.pressure, alpha=0.4)
right.plot(slow.x, slow.pressure)
right.set(xlabel="x / L, in the frame of the cylinder", ylabel="pressure / $G_0$", xlim=(-0.3, 0.3))
right.annotate("", (0.3, 0.9), (0.1, 0.9), xycoords="axes fraction", arrowprops={"arrowstyle": "->"})
right.text(0.12, 0.82, "rolling at 0.05 L/τ", transform=right.transAxes)
plt.show()
