"""
A tyre's tread
==============

A stone on the road is pressed into the tread within five milliseconds. The surface of the rubber has aged
to a stiff skin, which resists the indentation. A thicker skin gives a smaller contact, long after the
compound below has relaxed.
"""

import matplotlib.pyplot as plt

import gfmdlayer

tread = gfmdlayer.run(
    {
        "units": {"length": "mm", "stress": "MPa", "time": "s"},
        "grid": {"points": 1024, "period": 20.0},
        "layers": [
            {
                "thickness": 0.2,
                "poisson": 0.49,
                "material": {"model": "zener", "G0": 4.0, "Ginf": 30.0, "tau": 0.01},
            },
            {
                "thickness": 7.0,
                "poisson": 0.49,
                "material": {"model": "zener", "G0": 1.0, "Ginf": 8.0, "tau": 2e-3},
            },
            {
                "thickness": 2.0,
                "poisson": 0.49,
                "material": {"model": "zener", "G0": 0.6, "Ginf": 1.2, "tau": 5e-3},
            },
        ],
        "halfspace": {"shear_modulus": float("inf")},
        "punch": {"shape": "parabola", "radius": 5.0},
        "trajectory": {"control": "load", "load": 0.4, "ramp_time": 0.005},
        "time": {"end": 1.0, "step": "adaptive", "tolerance": 1e-3},
        "output": {"snapshots": [1.0]},
        "sweep": {"layers.0.thickness": [0.0, 0.1, 0.2, 0.4]},
    }
)

figure, (left, right) = plt.subplots(1, 2, figsize=(8.4, 3.3), layout="constrained")
for skin in tread.thickness.values:
    case = tread.sel(thickness=skin)
    left.semilogx(case.time[1:], 20.0 * case.contact_area_interpolated[1:], label=f"skin of {skin:g} mm")
    right.plot(case.x, case.pressure.isel(snapshot=-1))
left.set(xlabel="time [s]", ylabel="width of the contact [mm]")
right.set(xlabel="x [mm]", ylabel="pressure [MPa]", xlim=(-5, 5))
left.legend()
plt.show()
