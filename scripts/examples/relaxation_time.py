"""Find the relaxation time of the contact area in each case of a sweep.

    python scripts/examples/relaxation_time.py results/figure2-quick

The cells, marked by `# %%`, also run one by one in Jupyter, Spyder or VS Code.
"""

# %% The results: contact area along the swept keys and time. Cases with time steps of their own have rows,
# each with its time; such a row is missing in cases with fewer steps.
import math
import sys

import gfmdlayer

folder = sys.argv[1] if len(sys.argv) > 1 else "results/figure2-quick"
results = gfmdlayer.open_results(folder)
print(results)
along = "time" if "time" in results.dims else "row"

# %% When the punch comes to rest: the rows from there on are relaxation.
config = gfmdlayer.load(f"{folder}/config.yaml")
area, time = results["contact_area"], results["time"]
relaxing = area.notnull() & (time >= config.trajectory.ramp_time)
first, end = relaxing.argmax(along), area.notnull().sum(along) - 1

# %% The change of the area that is still to come, relative to the whole change.
change = area.isel({along: end}) - area.isel({along: first})
remaining = ((area.isel({along: end}) - area) / change).where(relaxing)

# %% The integral of this, by trapezoids, is the mean relaxation time: tau for exp(-t/tau). It is left out
# where the area changes by less than ten points of the grid.
before = {along: 1}
trapezoids = (remaining + remaining.shift(before)) / 2 * (time - time.shift(before))
cell = 1 / math.prod(config.grid.points)
relaxation_time = trapezoids.sum(along).where(abs(change) > 10 * cell)
relaxation_time.attrs = {"long_name": "relaxation time of the contact area", "units": "time"}

# %% A table, with the swept values as its index.
print(relaxation_time.to_series().rename("relaxation time").to_string())
