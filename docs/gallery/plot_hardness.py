"""
Asperities that yield
=====================

A rough surface is pressed into an elastic halfspace twice. Where the pressure reaches the hardness the
summits yield and stay lower, so the second cycle follows the way back of the first.
"""

import matplotlib.pyplot as plt

import gfmdlayer

HARDNESS, LOAD = 0.08, 0.016  # over the modulus E* = 4 of the halfspace: 0.02 and 0.004

data = gfmdlayer.run(
    {
        "grid": {"points": [192, 192]},
        "layer": {"thickness": 0.0},
        "punch": {
            "shape": "self_affine",
            "hurst": 0.8,
            "roll_off": 0.25,
            "short_cutoff": 0.03,
            "rms_slope": 0.1,
            "seed": 1,
        },
        "interface": {"law": "hard_wall", "hardness": HARDNESS},
        "trajectory": {
            "control": "load",
            "kind": "approach_retract",
            "load": LOAD,
            "approach_speed": LOAD,
            "cycles": 2,
        },
        "time": {"step": 1 / 16},
        "output": {"snapshots": [1.0, 4.0]},
    }
)

figure, panels = plt.subplots(1, 3, figsize=(10, 3.5), layout="constrained", width_ratios=(1.2, 1.2, 1))
maps = (
    (data.pressure[0] / HARDNESS, "pressure / hardness, at the first peak", "inferno"),
    (1e3 * data.imprint[1], "imprint after two cycles, in L/1000", "viridis"),
)
for panel, (field, label, colours) in zip(panels, maps, strict=False):
    shown = field.where(field > 0).T
    image = panel.imshow(shown, origin="lower", extent=(-0.5, 0.5, -0.5, 0.5), cmap=colours)
    panel.set(xlabel="one period L", xticks=[], yticks=[], facecolor="0.93")
    figure.colorbar(image, ax=panel, label=label, location="top", shrink=0.9)
for cycle, style in ((0, "-"), (1, "--")):
    part = data.sel(time=slice(2 * cycle, 2 * cycle + 2))
    panels[2].plot(1e3 * part.depth, part.mean_stress / LOAD, style, label=("first", "second")[cycle])
panels[2].set(xlabel="depth, in L/1000", ylabel="load / largest load")
panels[2].legend(title="cycle", frameon=False)
plt.show()
