"""
8. A sweep on a Slurm cluster
=============================

A rubber roller under eight loads, by an array of two jobs: each takes the cases that no other job has
claimed, and the last to end gathers the results. On a cluster ``bash slurm/submit.sh --array 2 sweep.yaml``
submits them; what each job runs is started here by hand, both at once.

*In another way.* Hertz's contact of a cylinder has the half-width a = (4 F R/(π E*))^(1/2) under a force F
per length, E* = 2 G/(1 - ν). The periodic images change it by a part of the order of (π a/L)²/6 in a cell
of the length L, the difference between Hertz's contact and one wave of Westergaard's at equal load; this is
the bound, 0.8 %.
"""

import subprocess
import sys
import tempfile
from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np

import gfmdlayer

folder = Path(tempfile.mkdtemp())
config, results = folder / "sweep.yaml", folder / "results"
config.write_text("""\
name: sweep
units: {length: mm, stress: MPa, time: s}
grid: {points: 1024, period: 40.0}
layer: {thickness: .inf, poisson: 0.5, material: {G0: 1.0, Ginf: 4.0, tau: 0.1}}
punch: {shape: parabola, radius: 25.0}
trajectory: {control: force, force: 1.0, ramp_time: 0.01}
time: {end: 4.0, tolerance: 1.0e-3}
sweep: {trajectory.force: {from: 0.05, to: 1.0, points: 8, spacing: log}}
""")
command = [sys.executable, "-m", "gfmdlayer", "run", str(config), "--out", str(results), "--shard"]
jobs = [subprocess.Popen([*command, f"{i}/2"], stderr=subprocess.DEVNULL) for i in (1, 2)]
assert [job.wait() for job in jobs] == [0, 0]

period, radius, modulus = 40.0, 25.0, 2 * 1.0 / (1 - 0.5)
with gfmdlayer.open_results(results) as data:
    last = data.isel(time=-1) if "time" in data.dims else data.where(data.time == 4.0).max("row")
    force, width = data["force"].to_numpy(), last.contact_area_interpolated.to_numpy() * period / 2
hertz = np.sqrt(4 * force * radius / (np.pi * modulus))

found, expected, within = float(width[-1]), float(hertz[-1]), float((np.pi * hertz[-1] / period) ** 2 / 6)
assert abs(found / expected - 1) < within
print(f"half-width under {force[-1]:.3g} N/mm: {found:.4f} mm; Hertz {expected:.4f} mm")

figure, panel = plt.subplots(figsize=(5.6, 3.4), layout="constrained")
panel.loglog(force, hertz, "k:", label="Hertz")
panel.loglog(force, width, "C0o", ms=4, label="sweep, after 4 s")
panel.set(xlabel="force [N/mm]", ylabel="half-width of the contact [mm]")
panel.set_yticks([0.7, 1.0, 2.0, 3.0], ["0.7", "1", "2", "3"])
panel.set_xticks([0.05, 0.1, 0.2, 0.5, 1.0], ["0.05", "0.1", "0.2", "0.5", "1"])
panel.minorticks_off()
panel.legend(frameon=False)
plt.show()
