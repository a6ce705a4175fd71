"""
How sure is each number?
========================

A sphere is pressed into a viscoelastic layer. `gfmdlayer.converge` computes the case again with fewer
points, other steps and another tolerance, and estimates what each of them does to each column: how sure a
number is, and what makes it better. The images, of the neighbours in the periodic cell, are shown beside the
errors and are not part of them.
"""

import matplotlib.pyplot as plt

import gfmdlayer

config = {
    "layer": {"thickness": 0.1},
    "halfspace": {"shear_modulus": 5.0},
    "punch": {"shape": "parabola", "radius": 1.0},
    "time": {"end": 2.0, "step": 0.1},
}
columns = ["contact_area", "contact_area_interpolated", "force"]
figure, panels = plt.subplots(1, 2, figsize=(9, 3.6), sharex=True, sharey=True, layout="constrained")
for axes, n in zip(panels, (48, 96), strict=True):
    sure = gfmdlayer.converge({**config, "grid": {"points": [n, n]}}, columns=columns, at="end")
    print(sure)
    found = sure.data.set_index(estimate="column").sel(estimate=columns)
    for k, source in enumerate(found.source.values):
        axes.barh(
            [row + 0.2 * (1.5 - k) for row in range(len(columns))],
            (found.errors / found.scale).sel(source=source),
            height=0.18,
            label=source,
        )
    names = [column.replace("_", " ") for column in columns]
    axes.set(xscale="log", xlim=(1e-9, 1), yticks=range(len(columns)), yticklabels=names)
    axes.set(xlabel="estimated relative error", title=f"{n} × {n} points")
figure.legend(*panels[0].get_legend_handles_labels(), loc="outside lower center", ncols=4, frameon=False)
plt.show()
