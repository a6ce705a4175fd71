"""The accuracy that cases note in their files (`case.accuracy`): the worst of each number."""

from __future__ import annotations

from collections.abc import Mapping
from contextlib import suppress
from functools import lru_cache
from pathlib import Path

from gfmdlayer.observables.numerics import ACCURACY, ACCURACY_PREFIX
from gfmdlayer.results.names import ResultsError
from gfmdlayer.results.netcdf import opened

FILES_READ = 200  # of complete cases, the first of them


def worst_accuracy(files: Mapping[int, Path]) -> list[str]:
    """Return the worst of each number that cases note on their accuracy, and the number of its case."""
    every: dict[str, dict[int, float]] = {column.name: {} for column in ACCURACY}
    for number, path in [*files.items()][:FILES_READ]:
        with suppress(OSError, ResultsError):  # removed, or not readable for this user
            held = _accuracy_of(path, path.stat().st_mtime_ns)
            for name, value in held.items():
                every[name][number] = value
    lines = []
    for name, values in every.items():
        if values:
            number = (min if name.endswith("_points") else max)(values, key=values.__getitem__)
            words = name.removeprefix(ACCURACY_PREFIX).replace("_", " ")
            lines.append(f"{words} {values[number]:.2g}" + (f" ({number:04d})" if len(values) > 1 else ""))
    return lines


@lru_cache(maxsize=4 * FILES_READ)
def _accuracy_of(path: Path, _changed: int) -> dict[str, float]:
    with opened(path) as h5:
        return {c.name: float(h5.attrs[c.name]) for c in ACCURACY if c.name in h5.attrs}
