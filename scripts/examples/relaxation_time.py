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

# %% The change of the area that is still to come, relative to the whole change.
area = at_rest["contact_area"]
change = area.isel(time=-1) - area.isel(time=0)
remaining = (area.isel(time=-1) - area) / change

# %% The integral of this is the mean relaxation time: tau for exp(-t/tau). It is left out where the area
# changes by less than ten points of the grid.
cell = 1 / math.prod(config.grid.points)
relaxation_time = remaining.integrate("time").where(abs(change) > 10 * cell)
relaxation_time.attrs = {"long_name": "relaxation time of the contact area", "units": "time"}

# %% A table, with the swept values as its index.
print(relaxation_time.to_series().rename("relaxation time").to_string())
