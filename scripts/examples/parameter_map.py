"""Draw a map of a quantity of your own over two swept parameters.

    python scripts/examples/parameter_map.py results/NAME [map.png]

for a sweep over two keys, such as

    sweep:
      layer.thickness: [0.03125, 0.0625, 0.125, 0.25]
      layer.material.Ginf: [2, 5, 10, 20]

`gfmdlayer plot results/NAME --kind map` draws contact area and mean pressure so, without any script. The
cells, marked by `# %%`, also run one by one in Jupyter, Spyder or VS Code.
"""

# %% The results, along two swept keys and time, or rows where cases have time steps of their own.
import sys
from pathlib import Path

import gfmdlayer
from gfmdlayer.figures.labels import Quantity
from gfmdlayer.figures.map_plots import draw_quantity
from gfmdlayer.figures.plot_style import new_figure, save, styled

folder = Path(sys.argv[1] if len(sys.argv) > 1 else "results/map")
picture = Path(sys.argv[2]) if len(sys.argv) > 2 else folder / "overshoot.png"
results = gfmdlayer.open_results(folder)

# %% How much larger the pressure was at its peak than it is in the end.
pressure = results["mean_pressure"]
along = "time" if "time" in pressure.dims else "row"
end = pressure.notnull().sum(along) - 1
overshoot = pressure.max(along) / pressure.isel({along: end})
print(overshoot.to_series().rename("overshoot").to_string())

# %% One colour for each pair of values.
with styled():
    figure = new_figure(1, 70.0)
    draw_quantity(
        figure.subplots(), overshoot, Quantity(r"$\tilde{p}_\mathrm{max} / \tilde{p}_\mathrm{end}$")
    )
save(figure, picture)
print(picture)
