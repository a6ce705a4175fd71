"""
3. A seal, and what leaks through it
====================================

Rough metal is pressed on rubber with 0.06 MPa. While the rubber relaxes, the contact grows and the leak
falls. Water at a pressure of up to 0.03 MPa takes the place of contact pressure and opens the seal again:
its leak is several times what a fluid that lifts nothing would lose. The bands are the intervals of doubt.

*In another way.* The slope s of the surface alone gives the contact area, in units of p/(E* s) with E* = 2
G/(1 - ν): the theory of Bush, Gibson and Thomas (2 π)^(1/2), and Persson's, erf(2^(1/2) p/(E* s)), less.
Computed contacts lie between them (Hyun et al., *Phys. Rev. E* 70 (2004) 026117): the middle is expected,
within half of their difference.
"""

import tempfile
import warnings
from math import erf
from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np

import gfmdlayer
from gfmdlayer.cli import main

warnings.simplefilter("ignore", UserWarning)  # the last throats have few points on this small grid
seal = Path(tempfile.mkdtemp()) / "seal.yaml"
main(["new", str(seal), "--like", "seal"])  # gfmdlayer new seal.yaml --like seal
data = gfmdlayer.run(
    seal,
    progress=False,
    output={"snapshots": {"from": 0.03, "to": 100.0, "points": 6, "spacing": "log"}},
)
water = {"viscosity": 1e-9, "length": 1.0, "diameter": 20.0}  # MPa s; a ring of 20 mm, 1 mm wide
over_time = gfmdlayer.leakage(data, pressure_drop=0.02, coupled=True, **water)
drops = [0.002, 0.005, 0.01, 0.02, 0.03]
over_pressure = gfmdlayer.leakage(data.isel(snapshot=[-1]), pressure_drop=drops, coupled=True, **water)

modulus, slope, pressure = 2 * 1.5 / (1 - 0.49), 0.1, 0.06
load = pressure / (modulus * slope)
persson, bush = erf(2**0.5 * load), (2 * np.pi) ** 0.5 * load
found, expected = float(data.contact_area_interpolated[-1]), (persson + bush) / 2
within = (bush - persson) / (bush + persson)
assert abs(found / expected - 1) < within
print(
    f"contact area {found:.3f} of the nominal one; Persson {persson:.3f}; Bush, Gibson and Thomas {bush:.3f}"
)

figure, panels = plt.subplots(1, 2, figsize=(8.2, 3.4), layout="constrained", sharey=True)
for panel, x, leak in (
    (panels[0], over_time.snapshot, over_time),
    (panels[1], 1e3 * np.array(drops), over_pressure.isel(snapshot=0)),
):
    panel.fill_between(x, leak.leak_rate_low, leak.leak_rate_high, alpha=0.3, lw=0)
    panel.loglog(x, leak.leak_rate, "C0o-", ms=3, label="the water lifts the rubber")
    panel.loglog(x, leak.leak_rate_one_way, "k:", label="it lifts nothing")
panels[0].set(xlabel="time [s], under 20 kPa", ylabel="leak of the ring [mm³/s]")
panels[1].set(xlabel="pressure of the water [kPa], after 100 s")
panels[1].set_xticks([2, 5, 10, 20, 30], ["2", "5", "10", "20", "30"])
panels[1].minorticks_off()
panels[1].legend(frameon=False)
plt.show()
