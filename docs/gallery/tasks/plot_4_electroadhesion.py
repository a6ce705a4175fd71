"""
4. Electroadhesion over voltage
===============================

A wavy electrode lies on a rubber film under insulation of 10 µm. The voltage falls from 100 V to zero in
200 s, slowly against the relaxation time of the film, 0.5 s, and the contact opens from its valleys.

*In another way.* In complete contact the attraction is uniform, ε0 (V/h)²/2 with the thickness h = 10 µm/3
of the insulation over its permittivity, and the elastic pressure K A cos(qx), with the stiffness K of the
relaxed film at the wave q of the electrode and its amplitude A. The valleys open where attraction and load,
0.1 kPa, fall below K A. The rows of the run are 0.5 V apart, 1 % of the voltage.
"""

import tempfile
from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np

import gfmdlayer
from gfmdlayer.cli import main

film = Path(tempfile.mkdtemp()) / "film.yaml"
main(["new", str(film), "--like", "electroadhesion"])  # gfmdlayer new film.yaml --like electroadhesion
end, highest = 200.0, 100.0
data = gfmdlayer.run(
    film,
    progress=False,
    interface={
        "law": "electrostatic",
        "voltage": np.array([[0.0, highest], [end, 0.0]]),  # a table of time [s] and voltage [V]
        "insulation": [{"thickness": 10.0, "permittivity": 3.0}],
    },
    time={"end": end, "tolerance": 1e-3},
    output={"times": 1.0},
    sweep={"grid.points": [512]},
).squeeze()
voltage = highest * (1 - data.time / end)

layer = gfmdlayer.bonded_layer(100.0, gfmdlayer.Zener(G0=20.0, Ginf=200.0, tau=0.5), poisson=0.45)
K = float(layer.stiffness([2 * np.pi / 250.0], 0.0)[0])  # kPa/µm, at rest
to_open = 10e-6 / 3.0 * np.sqrt(2 * 1e3 * (K * 1.0 - 0.1) / 8.8541878e-12)  # V
found, expected, within = float(voltage[data.contact_area > 1 - 1e-9].min()), float(to_open), 0.01
assert abs(found / expected - 1) < within
print(f"complete contact down to {found:.1f} V; by the stiffness of the film {expected:.1f} V")

figure, panel = plt.subplots(figsize=(5.6, 3.4), layout="constrained")
loading = data.time < 10.0  # the film relaxes under the full voltage
panel.plot(voltage[~loading], data.contact_area[~loading], "C0", label="falling voltage")
panel.axvline(expected, color="k", ls=":", label=f"valleys open, {expected:.1f} V")
panel.set(xlabel="voltage [V]", ylabel="contact area / nominal area", xlim=(0, highest), ylim=(0, 1.05))
panel.legend(frameon=False)
plt.show()
