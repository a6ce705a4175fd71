"""
2. A master curve of friction
=============================

A cylinder slides on rubber at three temperatures, without friction at the interface. Over the reduced speed
v aT, with the shift factor aT of Williams, Landel and Ferry, the friction at all temperatures is one curve:
a cold rubber is a fast one. ``gfmdlayer plot results/master-curve --x reduced_velocity --y friction`` draws
such a picture.

*In another way.* log aT = -C1 (T - T0)/(C2 + T - T0) is one at T0 - C2/(C1 + 1), and minus one at T0 +
C2/(C1 - 1). At the first of these temperatures the friction at 0.3 m/s is that of 3 m/s at 25 °C, at the
second that of 0.03 m/s. Both runs settle to 0.1 %.
"""

import tempfile
from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np

import gfmdlayer
from gfmdlayer.cli import main

C1, C2, T0 = 4.57, 113.6, 25.0  # of the configuration
temperatures = [T0 - C2 / (C1 + 1), T0, T0 + C2 / (C1 - 1)]
curve = Path(tempfile.mkdtemp()) / "master-curve.yaml"
main(["new", str(curve), "--like", "master-curve"])  # gfmdlayer new master-curve.yaml --like master-curve
data = gfmdlayer.run(
    curve,
    progress=False,
    grid={"points": 256, "period": 40.0},  # half of the configuration's points, for a quick picture
    time={"end": 20.0, "tolerance": 3e-3, "steady": 1e-3},
    sweep={"temperature.value": temperatures, "trajectory.velocity": [300.0, 3000.0]},
)
friction = data.friction.where(data.time == data.time.max("row")).max("row")  # of the steady states
cold, reference, warm = (friction.sel({"temperature.value": T}) for T in temperatures)

found, expected, within = float(cold.sel(velocity=300.0)), float(reference.sel(velocity=3000.0)), 2e-3
assert abs(found / expected - 1) < within
print(f"friction at {temperatures[0]:.1f} °C and 0.3 m/s: {found:.5f}; at 25 °C and 3 m/s: {expected:.5f}")

factors = np.array([gfmdlayer.WLF(C1=C1, C2=C2, reference=T0).factor(T) for T in temperatures])
figure, (measured, master) = plt.subplots(1, 2, figsize=(8.2, 3.4), layout="constrained", sharey=True)
for T, factor, marker in zip(temperatures, factors, "o^s", strict=True):
    one = friction.sel({"temperature.value": T})
    measured.semilogx(one.velocity / 1e3, one, f"{marker}-", label=f"{T:.1f} °C")
    master.semilogx(factor * one.velocity / 1e3, one, marker, fillstyle="none", ms=9)
reduced = np.outer(factors, friction.velocity / 1e3).ravel()
order = reduced.argsort()
master.plot(reduced[order], friction.to_numpy().ravel()[order], "k", lw=0.8)
measured.set(xlabel="speed [m/s]", ylabel="coefficient of friction", ylim=(0, None))
master.set(xlabel="reduced speed $v\\,a_T$ at 25 °C [m/s]")
measured.set_xticks([0.3, 1.0, 3.0], ["0.3", "1", "3"])
measured.minorticks_off()
measured.legend(frameon=False)
plt.show()
