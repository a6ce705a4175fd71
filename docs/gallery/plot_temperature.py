"""
A jump of the temperature
=========================

A cylinder is held in a cold rubber layer, which hardly relaxes. After five seconds the temperature rises
by 30 degrees within half a second: now the same relaxation takes a hundredth of the time. The law of
Williams, Landel and Ferry shifts all times by one factor. So a run at one temperature gives the result at
all others, and the code is exact for any temperature history.
"""

import tempfile
from pathlib import Path

import matplotlib.pyplot as plt

import gfmdlayer

folder = Path(tempfile.mkdtemp())
(folder / "heated.txt").write_text("0 0\n5 0\n5.5 30\n20 30\n")
common = {
    "units": {"length": "mm", "stress": "MPa", "time": "s"},
    "grid": {"points": 512, "period": 40.0},
    "layer": {
        "thickness": 2.0,
        "poisson": 0.49,
        "material": {
            "model": "fractional_zener",
            "G0": 0.5,
            "Ginf": 200.0,
            "tau": 1e-4,
            "exponent": 0.6,
            "shift": {"law": "wlf", "C1": 10.0, "C2": 110.0, "reference": 20.0},
        },
    },
    "halfspace": {"shear_modulus": float("inf")},
    "punch": {"shape": "cylinder", "radius": 30.0},
    "trajectory": {"depth": 0.2, "ramp_time": 1.0},
    "time": {"end": 20.0, "step": "adaptive", "tolerance": 1e-3},
    "output": {"times": 0.2},
}

figure, panel = plt.subplots(figsize=(6, 3.4), layout="constrained")
for label, temperature in (
    ("0 °C", {"value": 0.0}),
    ("30 °C", {"value": 30.0}),
    ("heated at 5 s", {"file": str(folder / "heated.txt")}),
):
    case = gfmdlayer.run(common, temperature=temperature)
    panel.semilogy(case.time[1:], case.mean_stress[1:], label=label, lw=3 if "file" in temperature else 1.2)
panel.axvspan(5.0, 5.5, color="C2", alpha=0.2, lw=0)
panel.set(xlabel="time [s]", ylabel="mean stress [MPa]", xlim=(0, 20), ylim=(0.03, 6))
panel.set_yticks([0.1, 1.0], ["0.1", "1"])
panel.legend()
plt.show()
