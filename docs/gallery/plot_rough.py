"""
A rough surface relaxing
========================

A constant load presses a self-affine surface into a layer on a rigid base. Between the two maps the layer
relaxes: the summits sink in, and contact spots merge.
"""

import matplotlib.pyplot as plt

import gfmdlayer

data = gfmdlayer.run(
    {
        "grid": {"points": [192, 192]},
        "layer": {"thickness": 0.2},
        "halfspace": {"shear_modulus": float("inf")},
        "punch": {
            "shape": "self_affine",
            "hurst": 0.8,
            "roll_off": 0.25,
            "short_cutoff": 0.03,
            "rms_slope": 0.1,
            "seed": 1,
        },
        "trajectory": {"control": "load", "load": 0.05, "ramp_time": 0.2},
        "time": {"end": 10.0, "step": "adaptive", "tolerance": 3e-3},
        "output": {"snapshots": [0.2, 10.0], "patches": True},
    }
)

figure, panels = plt.subplots(1, 3, figsize=(10, 3.5), layout="constrained", width_ratios=(1, 1, 1.2))
for panel, shot in zip(panels, data.snapshot.values, strict=False):
    pressure = data.pressure.sel(snapshot=shot)
    image = panel.imshow(
        pressure.where(pressure > 1e-9).T,
        origin="lower",
        extent=(-0.5, 0.5, -0.5, 0.5),
        cmap="inferno",
        vmax=1.5,
    )
    panel.set(xlabel=f"one period L, at t = {shot:g} τ", xticks=[], yticks=[], facecolor="0.93")
figure.colorbar(image, ax=panels[:2], label="pressure / $G_0$", extend="max", shrink=0.85)
panels[2].semilogx(data.time[1:], data.contact_area_interpolated[1:])
panels[2].set(xlabel="t/τ", ylabel="relative contact area", ylim=(0, None))
plt.show()
