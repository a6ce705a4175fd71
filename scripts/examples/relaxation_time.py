"""Find the relaxation time of the contact area in each case of a sweep.

    python scripts/examples/relaxation_time.py results/figure2-quick

The cells, marked by `# %%`, also run one by one in Jupyter, Spyder or VS Code.
"""

# %% The results: contact area and mean pressure along the swept keys and time.
import math
import sys

import gfmdlayer

folder = sys.argv[1] if len(sys.argv) > 1 else "results/figure2-quick"
results = gfmdlayer.open_results(folder)
print(results)

# %% When the punch comes to rest: the rows from there on are relaxation.
config = gfmdlayer.load(f"{folder}/config.yaml")
at_rest = results.sel(time=slice(config.trajectory.ramp_time, None))

# %% How far the area is from its last value, as a part of the way that it has to go.
area = at_rest["contact_area"]
way = area.isel(time=-1) - area.isel(time=0)
left = (area.isel(time=-1) - area) / way

# %% The integral of this is the mean relaxation time: tau for exp(-t/tau). Where the area moves by less than
# ten of the grid's points, it cannot be told.
cell = 1 / math.prod(config.grid.points)
relaxation_time = left.integrate("time").where(abs(way) > 10 * cell)
relaxation_time.attrs = {"long_name": "relaxation time of the contact area", "units": "time"}

# %% A table, with the swept values as its index.
print(relaxation_time.to_series().rename("relaxation time").to_string())
