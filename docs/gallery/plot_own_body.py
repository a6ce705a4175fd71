"""
A bed of springs and dashpots
=============================

The package has layers, crystals and tables; a class of your own is a body too. Here it is a Winkler
foundation of independent springs and dashpots, which is not in the package. Its points do not know of each
other, so that the contact is where the punch overlaps the surface, and pressure is in proportion to the
overlap.
"""

import matplotlib.pyplot as plt
import numpy as np

import gfmdlayer
from gfmdlayer import Solid, Spectrum
from gfmdlayer.validation.fields import Positive


class Bed(Solid):
    """K(s) = k (1 + s tau/(1 + s tau)) at all q."""

    k: Positive
    tau: Positive = 1.0

    @property
    def mean_stiffness(self):
        """Give the stiffness of the mean displacement."""
        return self.k

    def stiffness(self, waves, s):
        """Return K at wavenumbers and Laplace variables."""
        cycles = np.asarray(s) * self.tau
        return self.k * (1 + cycles / (1 + cycles)) * np.ones(np.shape(waves))

    def spectrum(self, waves):
        """Return one mode, the same at all wavenumbers."""
        k = np.full(np.shape(waves), self.k)
        return Spectrum(relaxed=k, weights=k[np.newaxis], times=np.full((1, *k.shape), self.tau))


config = {
    "grid": {"points": 512},
    "punch": {"shape": "parabola", "radius": 0.25},
    "trajectory": {"depth": 0.01, "ramp_time": 1.0},
    "time": {"end": 8.0, "step": "adaptive"},
    "output": {"snapshots": [1.0, 8.0], "times": 0.1},
}
figure, (left, right) = plt.subplots(1, 2, figsize=(8.6, 3.4), layout="constrained")
for tau in (0.3, 1.0, 3.0):
    data = gfmdlayer.run(config, body=Bed(k=5.0, tau=tau))
    left.plot(data.time, data.mean_stress, label=f"τ = {tau:g}")
    if tau == 1.0:
        for time, field in zip(data.snapshot.values, data.pressure, strict=True):
            right.plot(data.x, field, label=f"t = {time:g}")
        right.plot(data.x, 5.0 * np.maximum(0.01 - data.x**2 / 0.5, 0.0), "k:", label="k × overlap")
left.set(xlabel="time", ylabel="mean stress", ylim=(0, None))
left.legend(frameon=False)
right.set(xlabel="x", ylabel="pressure", xlim=(-0.12, 0.12))
right.legend(frameon=False)
plt.show()
