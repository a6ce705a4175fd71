"""The accuracy that cases note in their files (`case.accuracy`): the worst of each number of a sweep."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from gfmdlayer.observables.numerics import ACCURACY, ACCURACY_PREFIX
from gfmdlayer.results.netcdf import opened


def worst_accuracy(sweep: Path) -> list[str]:
    """Return the worst of each number in a sweep file, with the number of its case; few points are worst."""
    lines = []
    with opened(sweep) as h5:
        cases = np.ravel(h5["case"][...]) if "case" in h5 else np.zeros(1, int)
        for name in (column.name for column in ACCURACY if column.name in h5):
            values = np.ravel(h5[name][...])
            if not np.isfinite(values).any():
                continue
            worst = int((np.nanargmin if name.endswith("_points") else np.nanargmax)(values))
            words = name.removeprefix(ACCURACY_PREFIX).replace("_", " ")
            of = f" ({cases[worst]:04d})" if values.size > 1 else ""
            lines.append(f"{words} {values[worst]:.2g}{of}")
    return lines
