"""Draw the picture of README.md: punch, layer and halfspace, the relaxing pressure, and the curves.

usage: python scripts/picture.py [FILE]        default: docs/picture.svg, the picture in README.md
"""

from __future__ import annotations

import subprocess
import sys
import tempfile
from pathlib import Path

import matplotlib as mpl
import numpy as np
import xarray as xr

mpl.use("svg")
mpl.rcParams |= {"svg.fonttype": "none", "svg.hashsalt": "gfmdlayer", "font.size": 11}

from matplotlib import pyplot as plt  # noqa: E402 - after the choice of a backend

from gfmdlayer import open_case  # noqa: E402

ROOT = Path(__file__).parents[1]
TIMES = (1.0, 8.0)
COLOURS = ("#9c2b1f", "#1f5f8b")
DEPTH, THICKNESS, RADIUS = 0.01, 0.05, 0.25  # of configs/indentation-quick.yaml, in units of the period


def main(file: str = "docs/picture.svg") -> None:
    """Run an indentation and draw it."""
    with tempfile.TemporaryDirectory() as folder:
        config, out = str(ROOT / "configs/indentation-quick.yaml"), str(folder)
        run = [sys.executable, "-m", "gfmdlayer", "run", config, "--out", out]
        subprocess.run([*run, "--set", f"output.snapshots={list(TIMES)}"], check=True)
        case = open_case(Path(folder) / "cases/0000.h5").load()
    figure, (section, curves) = plt.subplots(
        1, 2, figsize=(9.6, 3.6), width_ratios=(1.5, 1), layout="constrained"
    )
    _draw_section(section, case)
    _draw_curves(curves, case)
    figure.savefig(file, metadata={"Date": None})


def _draw_section(axes: plt.Axes, case: xr.Dataset) -> None:
    near = case.sel(x=slice(-0.15, 0.15)).isel(x=slice(None, None, 2))
    x, u = near.x.values, near.displacement.sel(snapshot=TIMES[-1]).values
    axes.fill_between(x, -0.08, -THICKNESS, color="#b8bdc4", lw=0)
    axes.fill_between(x, -THICKNESS, u, color="#f5d9a8", lw=0)
    axes.plot(x, u, color="#8a6d3b", lw=1.2)
    punch = np.minimum(x**2 / (2 * RADIUS) + float(u.min()), 0.034)
    axes.fill_between(x, punch, 0.034, color="#5d6d7e", lw=0)
    axes.text(0, 0.022, "rigid punch", color="white", ha="center")
    axes.text(-0.142, -0.042, "viscoelastic layer  $G(t) = G_0 + (G_\\infty - G_0)\\,e^{-t/\\tau}$")
    axes.text(-0.142, -0.071, "elastic halfspace")
    for i, (time, colour) in enumerate(zip(TIMES, COLOURS, strict=True)):
        pressure = near.pressure.sel(snapshot=time).values / float(near.pressure.max())
        inside = np.convolve(pressure > 1e-3, np.ones(3), "same") > 0  # to the edges, where it is zero
        below = np.where(inside, u - 0.018 * pressure, np.nan)
        axes.fill_between(x, u, below, color=colour, alpha=0.25, lw=0)
        axes.plot(x, below, color=colour, lw=2)
        words = f"pressure at $t = {time:g}\\,\\tau$"
        axes.text(0.142, -0.017 - 0.011 * i, words, color=colour, ha="right")
    axes.set(xlim=(-0.15, 0.15), ylim=(-0.08, 0.034))
    axes.axis("off")


def _draw_curves(axes: plt.Axes, case: xr.Dataset) -> None:
    pressure, area = case.mean_pressure, case.contact_area_interpolated
    axes.plot(case.time, pressure, color="#1c2833", lw=2)
    axes.plot(case.time, area, color="#1e8449", lw=2)
    for time, colour in zip(TIMES, COLOURS, strict=True):
        axes.plot(time, pressure.sel(time=time, method="nearest"), "o", color=colour, ms=7, clip_on=False)
    axes.set(xlabel="time $t/\\tau$", xlim=(0, 8), ylim=(0, None))
    axes.spines[["top", "right"]].set_visible(False)
    axes.text(7.9, 0.056, "contact area, part of the cell", color="#1e8449", ha="right")
    axes.text(7.9, 0.02, "mean pressure $\\bar p/2G_0$", color="#1c2833", ha="right")


if __name__ == "__main__":
    main(*sys.argv[1:])
