"""
A master curve from five temperatures
=====================================

Moduli of a rubber, measured over three decades of the frequency at five temperatures, become one curve over
ten decades: a fit finds the Prony series and the constants of its shift together. The material then runs at
any temperature: creep under a cylinder at 35 °C is two thousand times as fast as at 5 °C.
"""

import matplotlib.pyplot as plt
import numpy as np

import gfmdlayer

true = gfmdlayer.WLF(C1=12.0, C2=110.0, reference=20.0)
rubber = gfmdlayer.Prony(100.0, [(1e4, 1e-4), (1e3, 1e-2), (300.0, 1.0), (30.0, 1e2)])
rng = np.random.default_rng(0)
rows = []
for T in (-10.0, 5.0, 20.0, 35.0, 50.0):
    omega = np.geomspace(0.1, 100.0, 16)
    modulus = rubber.complex_modulus(omega * true.factor(T)) * (1 + 0.01 * rng.standard_normal(16))
    rows += [(T, *row) for row in zip(omega, modulus.real, modulus.imag, strict=True)]
T, omega, storage, loss = np.transpose(rows)
fit = gfmdlayer.fit_material(
    {"T [degC]": T, "omega [rad/s]": omega, "G' [kPa]": storage, "G'' [kPa]": loss}, reference=20.0
)
print(fit)

config = {
    "units": {"length": "mm", "stress": "kPa", "time": "s"},
    "grid": {"points": 512, "period": 10.0},
    "layer": {"thickness": 1.0, "material": fit.material},
    "halfspace": {"shear_modulus": float("inf")},
    "punch": {"shape": "cylinder", "radius": 20.0},
    "trajectory": {"control": "load", "load": 10.0, "ramp_time": 1e-4},
    "time": {"end": 100.0, "step": "adaptive"},
}
figure, (left, right) = plt.subplots(1, 2, figsize=(8.6, 3.4), layout="constrained")
for temperature in np.unique(T):
    at = temperature == T
    (line,) = left.loglog(omega[at], storage[at], ".", alpha=0.4)
    left.loglog(omega[at] * fit.material.shift.factor(temperature), storage[at], "o", markersize=4,
                color=line.get_color(), label=f"{temperature:g} °C")  # fmt: skip
left.set(xlabel="ω and $a_T$ ω [rad/s]", ylabel="storage modulus [kPa]")
left.legend(frameon=False)
for temperature in (5.0, 20.0, 35.0):
    data = gfmdlayer.run(config, temperature={"value": temperature})
    right.semilogx(data.time[1:], data.depth[1:], label=f"{temperature:g} °C")
right.set(xlabel="time [s]", ylabel="depth [mm]", ylim=(0, None))
right.legend(frameon=False)
plt.show()
