"""
A measured history from a spreadsheet
=====================================

A spreadsheet exported a history of depth with German headings, decimal commas and units of its own. The run
reads it by its headings, converts the units, and says how. The force follows the steps of the depth and
relaxes between them.
"""

import tempfile
from pathlib import Path

import matplotlib.pyplot as plt

import gfmdlayer

file = Path(tempfile.mkdtemp()) / "export.csv"
file.write_text(
    "Probe: PDMS 10:1\n\nNr;Eindringtiefe;Zeit\n;nm;ms\n"
    "1;0,0;0\n2;150,5;500\n3;150,5;2000\n4;260,0;2500\n5;260,0;4000\n6;90,0;4500\n7;90,0;6000\n",
    encoding="cp1252",
)
data = gfmdlayer.run(
    {
        "units": {"length": "um", "stress": "MPa", "time": "s"},
        "grid": {"points": 256, "period": 20.0},
        "layer": {"thickness": 10.0, "material": {"G0": 1.0, "Ginf": 5.0, "tau": 0.3}},
        "halfspace": {"shear_modulus": 1e3},
        "punch": {"shape": "parabola", "radius": 10.0},
        "trajectory": {"kind": "table", "file": str(file)},
        "time": {"end": 6.0, "step": "adaptive"},
        "output": {"times": 0.05},
    }
)
print(data.attrs["read"])

figure, (left, right) = plt.subplots(1, 2, figsize=(8.6, 3.4), layout="constrained")
left.plot(data.time, data.depth, ".-", markersize=4)
left.set(xlabel="time [s]", ylabel="depth [µm]")
right.plot(data.time, data.mean_stress, ".-", markersize=4)
right.set(xlabel="time [s]", ylabel="mean stress [MPa]")
plt.show()
