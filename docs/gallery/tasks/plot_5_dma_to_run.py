"""
5. From a DMA curve to a run
============================

Storage and loss modulus of a rubber, with 1 % of noise, become a Prony series (``gfmdlayer fit-material
dma.csv``). A ball with a radius of 5 mm is then pressed 0.2 mm deep into a thick sheet of it, within 10 ms.

*In another way.* Ninomiya and Ferry read the relaxation modulus off the measured curve without any fit,
G(t) = G'(ω) - 0.40 G''(0.40 ω) + 0.014 G''(10 ω) at ω = 1/t, and Hertz gives the force 8/3 G/(1 - ν)
R^(1/2) d^(3/2). Their formula is right to some percent, the noise adds one; the ball is stiffer by d/(10 R)
than the parabola of Hertz, 0.4 %.
"""

import tempfile
from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np

import gfmdlayer
from gfmdlayer.cli import main

folder = Path(tempfile.mkdtemp())
sample = gfmdlayer.Prony(
    1.0, [(100.0, 1e-4), (30.0, 1e-3), (10.0, 1e-2), (4.0, 0.1), (2.0, 1.0), (1.0, 10.0)]
)
omega = np.geomspace(1e-2, 1e4, 43)
noise = 1 + 0.01 * np.random.default_rng(1).standard_normal((2, omega.size))
storage, loss = noise * np.array([sample.complex_modulus(omega).real, sample.complex_modulus(omega).imag])
fit = gfmdlayer.fit_material({"omega [rad/s]": omega, "G' [MPa]": storage, "G'' [MPa]": loss})
fit.write(folder / "rubber.yaml")

ball = folder / "ball.yaml"
main(["new", str(ball), "--like", "measured-rubber"])  # gfmdlayer new ball.yaml --like measured-rubber
depth, radius, poisson = 0.2, 5.0, 0.49
data = gfmdlayer.run(
    ball,
    progress=False,
    layer={"thickness": float("inf"), "poisson": poisson, "material": {"file": str(folder / "rubber.yaml")}},
    trajectory={"control": "depth", "depth": depth, "ramp_time": 0.01},
    time={"end": 10.0},
)


def read_off(t):
    """Return G(t) from the measured moduli, interpolated in logarithms."""
    G1, G2 = (
        lambda w, values=values: np.exp(np.interp(np.log(w), np.log(omega), np.log(values)))
        for values in (storage, loss)
    )
    return G1(1 / t) - 0.40 * G2(0.40 / t) + 0.014 * G2(10 / t)


hertz = 8 / 3 / (1 - poisson) * radius**0.5 * depth**1.5
found, expected, within = float(np.interp(1.0, data.time, data.force)), float(hertz * read_off(1.0)), 0.03
assert abs(found / expected - 1) < within
print(f"force after 1 s: {found:.3f} N; by Ninomiya and Ferry and Hertz {expected:.3f} N")

figure, (moduli, force) = plt.subplots(1, 2, figsize=(8.2, 3.4), layout="constrained")
fitted = fit.material.complex_modulus(omega)
for values, line, colour, name in ((storage, fitted.real, "C0", "G'"), (loss, fitted.imag, "C1", "G''")):
    moduli.loglog(omega, values, "o", color=colour, ms=3, label=f"{name}, measured")
    moduli.loglog(omega, line, colour, lw=1, label=f"{name}, fitted")
moduli.set(xlabel="angular frequency [rad/s]", ylabel="modulus [MPa]")
moduli.legend(frameon=False, fontsize=8)
times = np.geomspace(0.03, 10.0, 12)
force.loglog(data.time[1:], data.force[1:], "C0", label="run")
force.loglog(times, hertz * read_off(times), "k+", label="read off the measured curve")
force.set(xlabel="time [s]", ylabel="force [N]", xlim=(1e-3, 10), ylim=(1, 30))
force.legend(frameon=False, fontsize=8)
plt.show()
