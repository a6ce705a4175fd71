"""Export results to CSV, for a spreadsheet or another language.

    python scripts/examples/export_csv.py results/figure2-quick [FOLDER]

writes curves.csv, a line for each row of each case, and profiles.csv, a line for each case and point of the
surface at the last snapshot. The cells, marked by `# %%`, also run one by one in Jupyter, Spyder or VS Code.
"""

# %% The results; of the snapshots, only the parts that are used are read.
import sys
from pathlib import Path

import gfmdlayer

folder = Path(sys.argv[1] if len(sys.argv) > 1 else "results/figure2-quick")
out = Path(sys.argv[2]) if len(sys.argv) > 2 else folder
results = gfmdlayer.open_results(folder)

# %% The curves: columns for the swept keys, the time, and every number that the cases report over time.
numbers = [name for name, column in results.items() if column.dims[-1:] in (("time",), ("row",))]
curves = results[numbers].to_dataframe().reset_index().dropna(subset=["time"])
curves.to_csv(out / "curves.csv", index=False)
print(f"{out / 'curves.csv'}: {len(curves)} lines, {', '.join(curves.columns)}")

# %% The surface at the last snapshot, where the cases have one.
if "pressure" in results and results.sizes["snapshot"]:
    last = results[["displacement", "pressure"]].isel(snapshot=-1)
    profiles = last.to_dataframe().reset_index()
    profiles.to_csv(out / "profiles.csv", index=False)
    print(f"{out / 'profiles.csv'}: {len(profiles)} lines at time {float(last['snapshot']):g}")
