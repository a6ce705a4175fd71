"""
1. Friction of a coated roller
==============================

Two rollers with rubber coatings of 5 mm and 3 mm roll on each other at several speeds. The friction is the
loss of both coatings, and the columns ``friction_body`` and ``friction_counterbody`` split it.

*In another way.* In the steady state a coating sees the waves of the pressure pass at the frequencies q v.
Each loses the imaginary part of its compliance at this frequency, times q and the square of the wave. This
sum needs no time steps, and has to give the friction within the 0.1 % to which the run has settled.
"""

import tempfile
from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np

import gfmdlayer
from gfmdlayer.cli import main

rollers = Path(tempfile.mkdtemp()) / "rollers.yaml"
main(["new", str(rollers), "--like", "rollers"])  # gfmdlayer new rollers.yaml --like rollers
data = gfmdlayer.run(rollers, progress=False)
last = data.where(data.time == data.time.max("row")).max("row")  # the steady state of each speed

# The same from the last pressure: the waves of a period of 40 mm, which pass at the largest speed but one.
speed, period = float(data.velocity[3]), 40.0
pressure = data.pressure.sel(velocity=speed).isel(snapshot_row=-1).to_numpy()
waves = np.fft.rfft(pressure)[1:-1] / pressure.size
q = 2 * np.pi / period * np.arange(1, waves.size + 1)
losses = []
for thickness, relaxed, glassy in ((5.0, 1.0, 4.0), (3.0, 2.0, 6.0)):
    coating = gfmdlayer.bonded_layer(
        thickness, gfmdlayer.Zener(G0=relaxed, Ginf=glassy, tau=1e-3), poisson=0.49
    )
    compliance = 1 / coating.stiffness(q, 1j * q * speed)
    losses.append(2 * np.sum(q * abs(waves) ** 2 * -compliance.imag) / pressure.mean())

found, expected, within = float(last.friction.sel(velocity=speed)), float(sum(losses)), 1e-3
assert abs(found / expected - 1) < within
print(f"friction at {speed / 1e3:.3g} m/s: {found:.5f}; by the loss compliances {expected:.5f}")

figure, panel = plt.subplots(figsize=(5.6, 3.4), layout="constrained")
panel.semilogx(data.velocity / 1e3, last.friction, "ko-", label="both coatings")
panel.semilogx(data.velocity / 1e3, last.friction_body, "C0o--", label="5 mm, G₀ = 1 MPa")
panel.semilogx(data.velocity / 1e3, last.friction_counterbody, "C1o--", label="3 mm, G₀ = 2 MPa")
panel.plot([speed / 1e3] * 2, losses, "k+", ms=12, label="by the loss compliances")
panel.set(xlabel="speed [m/s]", ylabel="coefficient of rolling friction", ylim=(0, None))
panel.legend(frameon=False, fontsize=8)
plt.show()
