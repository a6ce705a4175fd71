"""
Creep under load
================

A load presses a parabola into a layer and stays constant. The layer relaxes: the punch sinks deeper, and
the contact grows. Both effects are larger for thicker layers.
"""

import matplotlib.pyplot as plt

import gfmdlayer

creep = gfmdlayer.run(
    {
        "trajectory": {"control": "load", "load": 0.02, "ramp_time": 0.1},
        "time": {"end": 30.0, "step": "adaptive"},
        "grid": {"points": 2048},
        "sweep": {"layer.thickness": [0.02, 0.05, 0.1, 0.2]},
    }
)

figure, (left, right) = plt.subplots(1, 2, figsize=(8, 3.2), layout="constrained")
for thickness in creep.thickness.values:
    case = creep.sel(thickness=thickness)
    left.semilogx(case.time[1:], case.depth[1:], label=f"d = {thickness:g} L")
    right.semilogx(case.time[1:], case.contact_area_interpolated[1:])
left.set(xlabel="time / τ", ylabel="depth / L", ylim=(0, 0.0115))
right.set(xlabel="time / τ", ylabel="relative contact area", ylim=(0, None))
left.legend(loc="upper left", fontsize=9)
plt.show()
