"""
Points across a contact
=======================

A parabola on an elastic halfspace has a closed form in a periodic cell. Counted points give the contact area
to a point at each edge; interpolated edges and the pressure need far fewer. On the right the periodic images
of a sphere shift its depth by 1.24 F/(E* L), in cells as wide as you can afford; without images the cell
hardly matters.
"""

import matplotlib.pyplot as plt
import numpy as np

import gfmdlayer

body, parabola = gfmdlayer.halfspace(1.0), gfmdlayer.Parabola(radius=0.25)
points = np.unique(np.geomspace(32, 2048, 24).astype(int) // 2 * 2)
lines = [gfmdlayer.solve(body, parabola, depth=0.01, points=int(n)) for n in points]
exact = 0.09008464
best = gfmdlayer.solve(body, parabola, depth=0.01, points=16384)
counted = [abs(float(found.contact_area) / exact - 1) for found in lines]
interpolated = [abs(float(found.contact_area_interpolated) / exact - 1) for found in lines]
pressure = [abs(float(found.mean_pressure / best.mean_pressure) - 1) for found in lines]

sphere, force, spacing = gfmdlayer.Parabola(radius=1.0), 0.01, 0.01
hertz = (3 * force / (4 * 4.0)) ** (2 / 3)
periods = np.array([0.5, 0.8, 1.2, 1.8, 2.6])
depths = {
    isolated: [
        float(
            gfmdlayer.solve(
                body, sphere, force=force, period=L, points=(round(L / spacing),) * 2, isolated=isolated
            ).depth
        )
        for L in periods
    ]
    for isolated in (False, True)
}
figure, (left, right) = plt.subplots(1, 2, figsize=(8.6, 3.4), layout="constrained")
across = exact * points
left.loglog(across, counted, "o", markersize=4, label="area, counted")
left.loglog(across, interpolated, "s", markersize=4, label="area, interpolated")
left.loglog(across, pressure, "^", markersize=4, label="mean pressure")
left.set(xlabel="points across the contact", ylabel="relative error")
left.legend(frameon=False)
radius = (3 * force / (4 * 4.0)) ** (1 / 3)
wide = periods / radius
right.plot(wide, np.array(depths[False]) / hertz, "o", label="periodic")
right.plot(wide, 1 - 1.24 * force / (4.0 * periods) / hertz, label="less 1.24 F/(E* L)")
right.plot(wide, np.array(depths[True]) / hertz, "s", label="isolated")
right.set(xlabel="period / contact radius", ylabel="depth / depth of Hertz", ylim=(0, 1.1))
right.legend(frameon=False)
plt.show()
