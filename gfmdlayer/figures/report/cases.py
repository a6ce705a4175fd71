"""The cases of a page, read from their files: thinned columns, surfaces, lists and attributes.

A page holds as many numbers as a browser takes in at once. Rows, points, snapshots and at last cases are
thinned to that, evenly; the page gives the numbers of rows, points and cases left out.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, NamedTuple

import h5py
import numpy as np

from gfmdlayer.arrays import FloatArray
from gfmdlayer.figures.plot_style import spread
from gfmdlayer.files.whole import is_intact
from gfmdlayer.results.reader import VERIFIED
from gfmdlayer.results.schema import FIELDS

CURVE_NUMBERS = SURFACE_NUMBERS = 1_200_000  # on a page; 6.4 MB each
LEAST_ROWS = 64
LEAST_POINTS = {1: 256, 2: 64 * 64}  # of a line and of a surface
MOST_POINTS = {1: 4096, 2: 512 * 512}
MOST_OF_LISTS = 1000  # entries
MOST_DEPTHS = 60
IN_TABLE = ("residual", "work", "energy_residual")  # columns whose extremes are in the table of cases


class Listed(NamedTuple):
    """A case of the configuration, computed or not."""

    number: int
    path: Path  # there if the case is complete
    values: Mapping[str, object]  # swept keys, dotted
    state: str = "complete"  # or running, failed, waiting
    reason: str = ""  # of the failure, or the progress


class Described(NamedTuple):
    """Attributes of a variable, and the names of its dimensions."""

    attributes: Mapping[str, str]
    dimensions: tuple[str, ...]


@dataclass
class Surfaces:
    """Snapshots of a case."""

    times: FloatArray  # those kept
    axes: dict[str, FloatArray]  # x and, of a surface, y: the points kept
    strides: tuple[int, ...]  # points of the file for each point kept, along each axis
    fields: dict[str, FloatArray]  # (snapshots, x[, y])
    among: int  # snapshots in the file
    # Depths, and von Mises stress (snapshots, depths, x) below the surface, of a surface along x through the
    # largest pressure; None without fields below the surface.
    inside: tuple[FloatArray, FloatArray] | None = None


@dataclass
class Contents:
    """The part of a case's file that a page shows."""

    attributes: dict[str, Any]
    rows: int = 0  # in the file
    # Columns along time, time itself included, at the rows kept; empty if the page has no room for the case.
    columns: dict[str, FloatArray] = field(default_factory=dict)
    # Column -> largest magnitude in the file; of a case without room, for the columns in the table.
    extremes: dict[str, float] = field(default_factory=dict)
    # Variables along any other dimension, and attributes that are arrays.
    lists: dict[str, FloatArray] = field(default_factory=dict)
    surfaces: Surfaces | None = None


class Reader:
    """Reads the cases of a page; `described` has the attributes and dimensions of each variable."""

    def __init__(self, cases: Sequence[Listed]) -> None:
        self._files = [case.number for case in cases if case.state == "complete"]
        self._with_curves: list[int] | None = None
        self._with_surfaces: set[int] | None = None
        self.described: dict[str, Described] = {}

    def read(self, case: Listed) -> Contents | None:
        """Return the contents of a case's file; None if it is damaged, or no complete file of a case."""
        try:
            if is_intact(case.path, VERIFIED) is False:
                return None
            with h5py.File(case.path, locking=False) as h5:
                return self._contents(case.number, h5) if h5.attrs.get("complete") == 1 else None
        except Exception:  # a damaged file can fail anywhere in HDF5, with any exception
            return None

    def _contents(self, number: int, h5: h5py.File) -> Contents:
        found = Contents(dict(h5.attrs), len(h5["time"]))
        variables = {name: each for name, each in h5.items() if isinstance(each, h5py.Dataset)}
        for name, each in variables.items():
            if name not in self.described:
                self.described[name] = _described(each)
        along = {name: self.described[name].dimensions for name in variables}
        columns = [name for name, axes in along.items() if axes[:1] == ("time",)]
        each_row = sum(variables[name].size for name in columns) / max(found.rows, 1)
        if self._with_curves is None:
            least = max(int(min(LEAST_ROWS, found.rows) * each_row), 1)
            self._with_curves = [self._files[i] for i in spread(len(self._files), CURVE_NUMBERS // least)]
        has_curves = number in self._with_curves
        kept = kept_rows(found.rows, max(int(CURVE_NUMBERS / (len(self._with_curves) * each_row)), 2))
        for name in columns if has_curves else set(columns).intersection(IN_TABLE):
            values = variables[name][...]
            finite = np.abs(values[np.isfinite(values)])
            found.extremes[name] = float(finite.max(initial=0.0))
            if has_curves:
                found.columns[name] = np.asarray(values[kept], dtype=float)
        held = {"time", "snapshot", "x", "y"}
        for name, axes in along.items():
            if axes and not held & {*axes, name} and variables[name].dtype.kind in "iuf" and len(axes) == 1:
                found.lists[name] = np.asarray(variables[name][:MOST_OF_LISTS], dtype=float)
        for name, value in found.attributes.items():
            if isinstance(value, np.ndarray) and value.ndim == 1 and value.dtype.kind in "iuf":
                found.lists[name] = value[:MOST_OF_LISTS].astype(float)
                self.described.setdefault(name, Described({}, (name,)))
        if has_curves and self._has_room(number, self._with_curves, h5):
            found.surfaces = self._surfaces(h5)
        return found

    def _has_room(self, number: int, among: list[int], h5: h5py.File) -> bool:
        """Whether the page has room for the snapshots of the case; if not for all, some cases have it."""
        if not len(h5["snapshot"]):
            return False
        if self._with_surfaces is None:
            least = 2 * sum(name in h5 for name in FIELDS) * LEAST_POINTS[h5["pressure"].ndim - 1]
            self._with_surfaces = {among[i] for i in spread(len(among), SURFACE_NUMBERS // least)}
        return number in self._with_surfaces

    def _surfaces(self, h5: h5py.File) -> Surfaces:
        times, shape = h5["snapshot"][...], h5["pressure"].shape[1:]
        fields = [name for name in FIELDS if name in h5]
        room = SURFACE_NUMBERS // (len(self._with_surfaces or (0,)) * len(fields))
        least = min(LEAST_POINTS[len(shape)], int(np.prod(shape)))
        kept = spread(len(times), max(2, room // least))
        most = min(MOST_POINTS[len(shape)], room // len(kept)) ** (1 / len(shape))
        strides = tuple(max(1, -int(-n // most)) for n in shape)
        part = tuple(slice(None, None, stride) for stride in strides)
        return Surfaces(
            times[kept],
            {name: h5[name][::stride] for name, stride in zip("xy", strides, strict=False)},
            strides,
            {name: np.array([h5[name][i][part] for i in kept]) for name in fields},
            len(times),
            self._inside(h5, kept, strides[0]),
        )

    @staticmethod
    def _inside(h5: h5py.File, kept: Sequence[int], stride: int) -> tuple[FloatArray, FloatArray] | None:
        """Read the von Mises stress below the surface."""
        if "von_mises" not in h5:
            return None
        rows = spread(len(h5["z"]), MOST_DEPTHS)
        field = h5["von_mises"]
        cut = () if field.ndim == 3 else (int(np.argmax(h5["pressure"][-1].max(axis=0))),)
        values = [[field[(i, k, slice(None, None, stride), *cut)] for k in rows] for i in kept]
        return h5["z"][...][rows], np.array(values)


def _described(dataset: h5py.Dataset) -> Described:
    words = {name: str(dataset.attrs[name]) for name in ("units", "long_name") if name in dataset.attrs}
    if dataset.is_scale:
        return Described(words, (dataset.name.rpartition("/")[2],))
    names = [dimension[0].name.rpartition("/")[2] if len(dimension) else "" for dimension in dataset.dims]
    return Described(words, tuple(names))


def kept_rows(rows: int, most: int) -> np.ndarray[Any, np.dtype[np.intp]]:
    """Return the rows that are kept: half evenly, half by equal ratios, for a logarithmic axis of time."""
    if rows <= most:
        return np.arange(rows)
    evenly = np.linspace(0, rows - 1, most - most // 2)
    return np.unique(np.rint([*evenly, *np.geomspace(1, rows - 1, most // 2)]).astype(np.intp))
