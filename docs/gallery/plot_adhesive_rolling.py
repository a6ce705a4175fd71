"""
Opening and closing edge of a rolling contact
=============================================

A cylinder rolls to the right over an adhesive viscoelastic layer. The surfaces close at the front edge
and open at the rear edge. If a point passes the edges within a relaxation time, the layer is stiff around
the rear edge. There the tension acts over a longer zone, and its force is up to 1.8 times the force at
the front edge: the rolling resistance is large. At low and at high speed the layer is elastic, and both
edges have the same force.
"""

import matplotlib.pyplot as plt
import numpy as np

import gfmdlayer

rolling = {
    "grid": {"points": 512},
    "layer": {"thickness": 0.1},
    "punch": {"shape": "cylinder", "radius": 0.5},
    "interface": {"law": "exponential", "work": 1e-3, "range": 2e-3},
    "trajectory": {"control": "load", "load": 0.005, "ramp_time": 1.0},
    "output": {"snapshots": "every"},
}


def rolled(speed):
    """Return the steady state, and the tensile forces behind and in front of the pressure maximum."""
    time = {"end": max(100, 3 / speed), "step": "adaptive", "tolerance": 1e-3, "steady": 1e-3}
    steady = gfmdlayer.run(rolling, time=time, trajectory__velocity=speed).isel(snapshot=-1, time=-1)
    middle, tension = steady.x[steady.pressure.argmax()], -steady.pressure.clip(max=0) / steady.x.size
    return steady, (tension.where(steady.x < middle).sum(), tension.where(steady.x > middle).sum())


speeds = np.array([1e-4, 1e-3, 3e-3, 0.01, 0.03, 0.1, 0.3, 1, 10])
cases = [rolled(speed) for speed in speeds]

figure, (left, right) = plt.subplots(1, 2, figsize=(8.8, 3.4), layout="constrained")
for k in (0, 3, 8):
    steady, _ = cases[k]
    left.plot(steady.x, steady.pressure, label=f"{speeds[k]:g}")
left.axhline(0, color="0.7", lw=0.8)
left.set(xlabel="x / L, in the frame of the cylinder", ylabel="pressure / $G_0$", xlim=(-0.15, 0.15))
left.legend(title="speed / (L/τ)", fontsize=8)
arrow = {"xycoords": "axes fraction", "arrowprops": {"arrowstyle": "->"}}
left.annotate("rolling", (0.3, 0.9), (0.04, 0.88), **arrow)
pulls = np.array([pull for _, pull in cases])
right.semilogx(speeds, pulls[:, 0] / 0.005, "o-", label="rear, opening")
right.semilogx(speeds, pulls[:, 1] / 0.005, "s--", label="front, closing")
right.set(xlabel="speed / (L/τ)", ylabel="tensile force at the edge / load", ylim=(0, None))
right.legend(fontsize=8)
plt.show()
