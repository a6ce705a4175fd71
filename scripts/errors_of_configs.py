"""Write docs/verification/errors.md: the estimated errors of the quick configurations in configs/.

    python scripts/errors_of_configs.py [--jobs N] [NAME ...]

Of each configuration `gfmdlayer.converge` gives the error of each kind of number: the largest over its
moments and, of a sweep, over the corners and the middle. NAME: print the rows of these configurations only.
"""

from __future__ import annotations

import argparse
import sys
import warnings
from collections.abc import Sequence
from pathlib import Path

import numpy as np

import gfmdlayer

ROOT = Path(__file__).parents[1]
PAGE = ROOT / "docs/verification/errors.md"
# In the order in which a column of the table takes the first that a configuration has.
KINDS = {
    "contact area or radius": ("contact_area_interpolated", "area_interpolated", "contact_radius"),
    "force, pressure or depth": ("force", "mean_pressure", "depth"),
    "work": ("work",),
    "friction": ("friction", "tangential_force"),
}
HEAD = """# Errors of the quick configurations

Made by `python scripts/errors_of_configs.py`. The quick configurations are small, for a first look. The table
has the errors that `gfmdlayer converge` estimates, relative to the largest value of each number, at the worst
time. Of a sweep it has the worst of the corners and the middle.

"""


def row(path: Path, jobs: int) -> str:
    """Return the row of a configuration."""
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            found = gfmdlayer.converge(path, progress=False, jobs=jobs)
    except (gfmdlayer.ConfigError, RuntimeError) as error:
        return f"| {path.stem} | {str(error).splitlines()[0]} |" + " |" * (len(KINDS) + 1)
    data = found.data
    relative = (data["error"] / data["scale"]).to_numpy()
    names = data["column"].to_numpy()
    cells = []
    for candidates in KINDS.values():
        errors = (relative[names == name] for name in candidates)
        largest = (np.nanmax(each) for each in errors if np.isfinite(each).any() and np.nanmax(each) > 0)
        first = next(largest, None)
        cells.append("" if first is None else f"{first:.0e}")
    parts = data["errors"].to_numpy()[np.nanargmax(np.where(np.isfinite(relative), relative, -1.0))]
    most = str(data["source"].to_numpy()[np.nanargmax(parts)])
    keys = ", ".join(f"{key}: {value}" for key, value in found.suggested.items() if key == "grid.points")
    return "| " + " | ".join([path.stem, *cells, most, keys]) + " |"


def main(arguments: Sequence[str] | None = None) -> int:
    """Write the page, or print some rows."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").partition("\n")[0])
    parser.add_argument("names", nargs="*")
    parser.add_argument("--jobs", type=int, default=1)
    options = parser.parse_args(arguments)
    paths = sorted((ROOT / "configs").glob("*-quick.yaml"))
    chosen = [path for path in paths if not options.names or path.stem in options.names]
    rows = [row(path, options.jobs) for path in chosen]
    heads = ["configuration", *KINDS, "most of it from", "for 1e-3"]
    table = ["| " + " | ".join(heads) + " |", "|" + " --- |" * len(heads), *rows]
    if options.names:
        print("\n".join(table))
    else:
        PAGE.write_text(HEAD + "\n".join(table) + "\n", encoding="utf-8")
    return 0


if __name__ == "__main__":
    sys.exit(main())
