"""
A seal that closes as it relaxes
================================

A rough surface is pressed against a viscoelastic body under a constant load. The fluid flows through the
channels between the contact spots. As the body relaxes the channels close, and the flow falls by two decades
in four decades of time. The cube of the critical gap, the width of the narrowest place, estimates the flow.
"""

import warnings

import matplotlib.pyplot as plt
import numpy as np

import gfmdlayer

warnings.simplefilter("ignore", UserWarning)  # the last throats have few points on this small grid
data = gfmdlayer.run(
    {
        "grid": {"points": [128, 128]},
        "layer": {"thickness": float("inf")},
        "punch": {
            "shape": "self_affine",
            "hurst": 0.8,
            "roll_off": 0.25,
            "short_cutoff": 0.04,
            "rms_slope": 0.1,
            "seed": 1,
        },
        "trajectory": {"control": "load", "load": 0.04, "ramp_time": 0.005},
        "time": {"end": 100.0, "step": "adaptive", "tolerance": 3e-3},
        "output": {"snapshots": [0.01, 100.0], "observables": ["critical_gap_x"], "leakage": {}},
    }
)
flow = gfmdlayer.leakage(data, fields=True)

figure, panels = plt.subplots(1, 3, figsize=(10, 3.6), layout="constrained", width_ratios=(1, 1, 1.15))
for panel, shot in zip(panels, data.snapshot.values, strict=False):
    one = flow.sel(snapshot=shot)
    size = np.hypot(one.flow_x, one.flow_y).values.T
    u, v = (np.where(size > 1e-4 * size.max(), each.values.T, np.nan) for each in (one.flow_x, one.flow_y))
    panel.imshow(
        one.fluid_pressure.T,
        origin="lower",
        extent=(-0.5, 0.5, -0.5, 0.5),
        cmap="RdBu_r",
        vmin=-0.5,
        vmax=0.5,
    )
    panel.streamplot(
        one.x.values, one.y.values, u, v,
        color="black", linewidth=0.3 + 1.5 * np.sqrt(size / size.max()), arrowsize=0.6,
    )  # fmt: skip
    panel.set(xlabel=f"one period L, at t = {shot:g} τ", xticks=[], yticks=[], facecolor="0.35")
    panel.set(xlim=(-0.5, 0.5), ylim=(-0.5, 0.5))
rows = data.isel(time=slice(1, None))
panels[2].loglog(rows.time, rows.flow_xx, "o-", markersize=3, label="flow along x")
panels[2].loglog(rows.time, rows.critical_gap_x**3, "--", label="(critical gap)³")
panels[2].set(xlabel="t/τ", ylabel="flow / L³", xlim=(0.004, None))
panels[2].legend(frameon=False)
plt.show()
