"""The page of a case or a sweep: data, style and program in one HTML file, which needs no network.

The data are in JSON, in the units of the figures: the units of the configuration, or the scales of the paper.
Plotly.js (MIT licence), from the package `plotly`, draws the curves.

A page holds as many numbers as a browser takes in at once. Rows, points, snapshots and at last cases are
thinned to that, evenly; the page gives the numbers of rows, points and cases left out.
"""

from __future__ import annotations

import base64
import io
import json
import math
import re
from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, field
from html import escape
from importlib.resources import files
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

import h5py
import numpy as np
import xarray
from matplotlib import colormaps
from matplotlib.colors import to_hex

from gfmdlayer.arrays import FloatArray
from gfmdlayer.figures.convergence_plot import convergence_figure
from gfmdlayer.figures.labels import quantity, symbol
from gfmdlayer.figures.plot_style import (
    CONTACT,
    GAP_COLOURS,
    PRESSURE_COLOURS,
    check_suffix,
    highest_row,
    spread,
    styled,
)
from gfmdlayer.figures.report import summary
from gfmdlayer.figures.selection import default_columns, value_titles
from gfmdlayer.files.whole import is_intact, write_text
from gfmdlayer.observables.contact import FEWEST
from gfmdlayer.observables.energy_balance import UNBALANCED
from gfmdlayer.results.accuracy import worst_accuracy
from gfmdlayer.results.convergence import FILE, open_convergence
from gfmdlayer.results.gathering import lay_out
from gfmdlayer.results.names import FIELDS, SWEEP_FILE, ResultsError, described_key
from gfmdlayer.results.netcdf import opened
from gfmdlayer.results.provenance import LIBRARIES, OWN_FFTW, duration, now, provenance
from gfmdlayer.results.reader import VERIFIED
from gfmdlayer.results.stored import unit_of
from gfmdlayer.validation import text

if TYPE_CHECKING:
    from numpy.typing import ArrayLike


# The cases, read from their files: thinned columns, surfaces, lists and attributes.

CURVE_NUMBERS = SURFACE_NUMBERS = 450_000  # on a page; 2.4 MB each, beside the 4.5 MB of Plotly
LEAST_ROWS = 24
# Left out of the curves where the page has not room for all columns of all cases.
SECONDARY = (
    "iterations", "rejected", "transforms", "residual", "contact_area_error", "area_error",
    "throat_points_x", "throat_points_y", "flow_imbalance",
)  # fmt: skip
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
            with opened(case.path) as h5:
                return self._contents(case.number, h5) if h5.attrs.get("complete") == 1 else None
        except Exception:  # a damaged file can fail anywhere in HDF5, with any exception
            return None

    def _contents(self, number: int, h5: h5py.File) -> Contents:
        contents = Contents(dict(h5.attrs), len(h5["time"]))
        variables = {name: dataset for name, dataset in h5.items() if isinstance(dataset, h5py.Dataset)}
        for name, dataset in variables.items():
            if name not in self.described:
                self.described[name] = _described(dataset)
        along = {name: self.described[name].dimensions for name in variables}
        columns = [name for name, axes in along.items() if axes[:1] == ("time",)]

        def each_row(names: Sequence[str]) -> float:
            return float(sum(variables[name].size for name in names) / max(contents.rows, 1))

        fewest = min(LEAST_ROWS, contents.rows)
        shown = columns
        if len(self._files) * fewest * each_row(columns) > CURVE_NUMBERS:
            shown = [name for name in columns if name not in SECONDARY]
        if self._with_curves is None:
            least = max(int(fewest * each_row(shown)), 1)
            self._with_curves = [self._files[i] for i in spread(len(self._files), CURVE_NUMBERS // least)]
        has_curves = number in self._with_curves
        room = int(CURVE_NUMBERS / (len(self._with_curves) * each_row(shown)))
        kept = kept_rows(contents.rows, max(room, 2))
        for name in columns:
            if name not in IN_TABLE and not (has_curves and name in shown):
                continue
            values = variables[name][...]
            finite = np.abs(values[np.isfinite(values)])
            contents.extremes[name] = float(finite.max(initial=0.0))
            if has_curves and name in shown:
                contents.columns[name] = np.asarray(values[kept], dtype=float)
        held = {"time", "snapshot", "x", "y"}
        for name, axes in along.items():
            if axes and not held & {*axes, name} and variables[name].dtype.kind in "iuf" and len(axes) == 1:
                contents.lists[name] = np.asarray(variables[name][:MOST_OF_LISTS], dtype=float)
        for name, value in contents.attributes.items():
            if isinstance(value, np.ndarray) and value.ndim == 1 and value.dtype.kind in "iuf":
                contents.lists[name] = value[:MOST_OF_LISTS].astype(float)
                self.described.setdefault(name, Described({}, (name,)))
        if has_curves and self._has_room(number, self._with_curves, h5):
            contents.surfaces = self._surfaces(h5)
        return contents

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
        cut = () if field.ndim == 3 else (highest_row(h5["pressure"][-1]),)
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


# Labels of the figures as HTML, and numbers in base64.
#
# Labels are mathtext, "$\tilde{p}/G_0$". HTML needs letters, accents, subscripts and powers only.

_SIGNS = {
    "alpha": "α", "beta": "β", "gamma": "γ", "delta": "δ", "epsilon": "ε", "eta": "η", "theta": "θ",
    "kappa": "κ", "lambda": "λ", "mu": "μ", "nu": "ν", "xi": "ξ", "pi": "π", "rho": "ρ", "sigma": "σ",
    "tau": "τ", "phi": "φ", "psi": "ψ", "omega": "ω", "Delta": "Δ", "infty": "∞", "times": "×",
    "prime": "′",
}  # fmt: skip
_ACCENTS = {"bar": "\u0304", "tilde": "\u0303", "hat": "\u0302", "dot": "\u0307"}
_RAISED = str.maketrans("0123456789-+", "⁰¹²³⁴⁵⁶⁷⁸⁹⁻⁺")

_ACCENT = re.compile(r"\\(bar|tilde|hat|dot)\{([^{}]*)\}")
_UPRIGHT_INDEX = re.compile(r"([_^])\\mathrm\{([^{}]*)\}")
_UPRIGHT = re.compile(r"\\mathrm\{([^{}]*)\}")
_SIGN = re.compile(r"\\([A-Za-z]+) ?")
_INDEX = re.compile(r"([_^])(?:\{([^{}]*)\}|(.))")


def html(label: str) -> str:
    """Write a label, the parts between dollar signs being mathtext, as HTML with subscripts."""
    parts = label.split("$")
    return "".join(_mathtext(part) if i % 2 else escape(part, quote=False) for i, part in enumerate(parts))


def _mathtext(part: str) -> str:
    text = _ACCENT.sub(lambda match: match[2] + _ACCENTS[match[1]], part.replace(r"\,", "\u2009"))
    text = _UPRIGHT.sub(r"\1", _UPRIGHT_INDEX.sub(r"\1{\2}", text))
    text = _SIGN.sub(lambda match: _SIGNS.get(match[1], match[1]), text)
    return _INDEX.sub(_index, escape(text, quote=False)).translate({ord("{"): None, ord("}"): None})


def _index(match: re.Match[str]) -> str:
    """Raise a power in Unicode, which needs no tags, and lower an index by a tag."""
    inner = match[2] or match[3]
    if match[1] == "_":
        return f"<sub>{inner}</sub>"
    return inner.translate(_RAISED) if re.fullmatch(r"[-+0-9]+", inner) else f"<sup>{inner}</sup>"


def packed(values: ArrayLike) -> str:
    """Return numbers as base64 of single precision, little-endian: seven digits."""
    with np.errstate(over="ignore"):
        return base64.b64encode(np.asarray(values, dtype="<f4").tobytes()).decode("ascii")


def plain(value: Any) -> Any:
    """Return an attribute for JSON: a number, or text; None for NaN."""
    if isinstance(value, bytes):
        return value.decode(errors="replace")
    if isinstance(value, np.ndarray):
        return ", ".join(str(plain(item)) for item in value.ravel().tolist())
    if isinstance(value, np.generic):
        value = value.item()
    if isinstance(value, float) and not math.isfinite(value):
        return None if math.isnan(value) else str(value)
    return value if isinstance(value, int | float | str) else str(value)


SOFTWARE = (
    "gfmdlayer_version",
    "git_commit",
    "python_version",
    *(f"{name}_version" for name in LIBRARIES),
    *OWN_FFTW,
)


def warnings(contents: Contents) -> list[str]:
    """Return the doubts about a case, from its file."""
    said = str(contents.attributes.get("warnings", "")).splitlines()
    noted = any(line.startswith("COARSE") for line in said)  # files of earlier versions have only the number
    if not noted and 0 < (points := int(contents.attributes.get("most_contact_points", FEWEST))) < FEWEST:
        said.append(f"coarse: at most {points} point{'s' * (points > 1)} in contact")
    if contents.attributes.get("settled") == 0:
        said.append("not steady at the end")
    return said


def origins(complete: Sequence[Contents]) -> dict[str, str]:
    """Return the values of each attribute of provenance over the cases; times from the first to the last."""
    shown: dict[str, str] = {}
    for name in (*SOFTWARE, "hostname"):
        values = dict.fromkeys(
            str(contents.attributes[name]) for contents in complete if name in contents.attributes
        )
        if values:
            shown[name.replace("_", " ")] = ", ".join(values)
    for name, choose in (("started", min), ("finished", max)):
        if every := [str(contents.attributes[name]) for contents in complete if name in contents.attributes]:
            shown[name] = choose(every)
    seconds = [float(contents.attributes.get("wall_seconds", 0.0)) for contents in complete]
    if seconds:
        shown["time, all cases"] = duration(sum(seconds))
    return shown


def notes(cases: Sequence[Listed], complete: Sequence[Contents]) -> dict[str, str]:
    """Return notes on the curves and surfaces that the page leaves out."""
    drawn = [contents for contents in complete if contents.columns]
    thinned = [contents for contents in drawn if len(contents.columns["time"]) < contents.rows]
    left_out = {"curves": "", "surfaces": ""}
    if len(drawn) < len(complete):
        left_out["curves"] = f"The page shows the curves of {len(drawn)} of {len(complete)} complete cases. "
    if thinned:
        widest = max(thinned, key=lambda contents: contents.rows)
        left_out["curves"] += (
            f"The page shows up to {len(widest.columns['time'])} of {widest.rows} rows of a case."
        )
    have = sum(int(contents.attributes.get("snapshots", 0)) > 0 for contents in complete)
    held = sum(contents.surfaces is not None for contents in complete)
    if held < have:
        left_out["surfaces"] = f"The page shows the surfaces of {held} of {len(cases)} cases."
    return left_out


SCALES = ("L", "G0", "tau")
# Attributes that have a place of their own on the page.
PLACED = {
    *("config", "digest", "hostname", "started", "finished", "wall_seconds", "rows", "snapshots", "complete"),
    *(*SOFTWARE, *SCALES, "name", "warnings", "settled", "coordinates"),
}


class Drawn(NamedTuple):
    """How a variable is drawn: label of its axis, symbol, and the divisor of the values in the file."""

    label: str
    symbol: str
    divisor: float

    @classmethod
    def of(cls, name: str, attributes: Mapping[str, str], scales: Mapping[str, Any], largest: float) -> Drawn:
        """Return it for values up to `largest`: the power of ten goes with the unit, if it has one."""
        axis = quantity(xarray.DataArray(np.nan, name=name, attrs=dict(attributes)), scales)
        axis = axis.fit([largest / axis.scale]) if axis.unit else axis
        return cls(html(axis.label), html(axis.symbol), axis.scale * 10.0**axis.power)

    def __call__(self, values: Any) -> str:
        """Return values as the page holds them."""
        return packed(np.asarray(values) / self.divisor)


class PageKeys(NamedTuple):
    """The swept keys of the page, their coordinates, and for each case the places of its values."""

    keys: list[dict[str, Any]]
    coordinates: dict[str, xarray.DataArray]
    places: list[list[int]]


def payload(cases: Sequence[Listed], config: str = "") -> dict[str, Any]:
    """Read the cases, and return the data of their page for `json.dumps`; see `write_report`."""
    reader = Reader(cases)
    contents = [reader.read(case) if case.state == "complete" else None for case in cases]
    complete = [content for content in contents if content is not None]
    scales = {
        name: complete[0].attributes[name]
        for name in SCALES
        if complete and len({content.attributes.get(name) for content in complete}) == 1
        if name in complete[0].attributes
    }
    stored = text.read(str(complete[0].attributes.get("config", "")), "").data if complete else None
    unit = unit_of(stored if isinstance(stored, dict) else {})
    swept = _swept(cases, unit)
    described = reader.described
    columns, fields = (find(complete, described, scales) for find in (_columns, _fields))
    listed = [
        _case(case, content, places, (columns, fields, described))
        for case, content, places in zip(cases, contents, swept.places, strict=True)
    ]
    return {
        "keys": swept.keys,
        "columns": [
            {
                "name": name,
                "label": drawn.label,
                "symbol": drawn.symbol,
                "meaning": described[name].attributes.get("long_name", ""),
            }
            | _bins(name, described, complete, scales)
            for name, drawn in columns.items()
        ],
        "shown": _shown_first(columns, complete, swept),
        "fields": {name: drawn.label for name, drawn in fields.items()},
        "cases": listed,
        "doubts": summary.doubts(listed),
        "first": summary.looked_at_first(listed),
        "config": config or next((str(content.attributes.get("config", "")) for content in complete), ""),
        "provenance": origins(complete),
        "notes": notes(cases, complete),
    }


def _swept(cases: Sequence[Listed], unit: Callable[[str], str]) -> PageKeys:
    keys = list(dict.fromkeys(key for case in cases for key in case.values))
    layout = lay_out([case.values for case in cases], keys, listed=True)
    keys_of_page, coordinates, places = [], {}, []
    for name, label in layout.labels.items():
        labels, inverse = np.unique(label.values, return_inverse=True)
        if label.values.dtype.kind == "U":  # in the order of the configuration
            order = list(dict.fromkeys(label.values.tolist()))
            labels, inverse = np.array(order), np.array([order.index(text) for text in label.values])
        coordinate = xarray.DataArray(labels, dims=name, name=name, attrs=described_key(label.key, unit))
        titles = [html(title) for title in value_titles(coordinate)]
        is_number = label.values.dtype.kind in "if"
        keys_of_page.append(
            {
                "key": label.key,
                "symbol": html(symbol(coordinate)),
                "meaning": coordinate.attrs.get("long_name", label.key),
                "titles": titles,
                "values": [plain(value) for value in labels.tolist()] if is_number else None,
            }
        )
        coordinates[name] = coordinate
        places.append(inverse.tolist())
    by_case = [list(each) for each in zip(*places, strict=True)] if places else [[] for _ in cases]
    return PageKeys(keys_of_page, coordinates, by_case)


def _columns(
    complete: Sequence[Contents], described: Mapping[str, Described], scales: Mapping[str, Any]
) -> dict[str, Drawn]:
    """Return all columns that any case has, time first."""
    names = dict.fromkeys(["time", *(name for contents in complete for name in sorted(contents.columns))])
    largest = {
        name: max((contents.extremes.get(name, 0.0) for contents in complete), default=0.0) for name in names
    }
    known = (name for name in names if name in described)
    return {name: Drawn.of(name, described[name].attributes, scales, largest[name]) for name in known}


def _fields(
    complete: Sequence[Contents], described: Mapping[str, Described], scales: Mapping[str, Any]
) -> dict[str, Drawn]:
    """Return how the surfaces are drawn: positions, fields and time; the gap in the unit of the surface's."""
    surfaces = [each.surfaces for each in complete if each.surfaces is not None]
    if not surfaces:
        return {}
    known = {
        name: described[name].attributes
        for name in ("snapshot", "x", "y", *FIELDS, "z", "von_mises")
        if name in described
    }
    inside = [each.inside for each in surfaces if each.inside is not None]

    def largest(name: str) -> float:
        if name in (below := ("z", "von_mises")):
            return max(
                (float(np.nanmax(each[below.index(name)], initial=0.0)) for each in inside), default=0.0
            )
        every = (each.axes.get(name, each.fields.get(name)) for each in surfaces)
        # Slip velocities are NaN without contact.
        return max(
            (float(np.nanmax(np.abs(each), initial=0.0)) for each in every if each is not None), default=0.0
        )

    times = max(float(each.times.max()) for each in surfaces)
    sizes = {name: largest(name) for name in known} | {"snapshot": times}
    sizes |= {"gap": sizes["displacement"]} if "gap" in sizes else {}
    sizes |= dict.fromkeys(sizes.keys() & {"x", "y"}, sizes["x"] / 2)  # the contact is a part of it
    return {name: Drawn.of(name, each, scales, sizes[name]) for name, each in known.items()}


def _bins(
    name: str, described: Mapping[str, Described], complete: Sequence[Contents], scales: Mapping[str, Any]
) -> dict[str, Any]:
    """Return the label and the lower ends of the bins of a distribution; nothing for a number."""
    if len(described[name].dimensions) < 2:
        return {}
    along = described[name].dimensions[1]
    both = (along, f"{along}_end")
    ends = next(
        ([contents.lists[end] for end in both] for contents in complete if contents.lists.keys() >= {*both}),
        None,
    )
    if ends is None:
        return {}
    edges = np.append(ends[0], ends[1][-1])
    largest = float(np.abs(edges[np.isfinite(edges)]).max())
    drawn = Drawn.of(along.removesuffix("_bin"), described[along].attributes, scales, largest)
    edges = edges / drawn.divisor
    return {"bins": {"label": drawn.label, "edges": [plain(edge) for edge in edges.tolist()]}}


def _shown_first(columns: Mapping[str, Drawn], complete: Sequence[Contents], swept: PageKeys) -> list[str]:
    """Return the two columns that are drawn when the page opens, chosen as for the figures."""
    about = {"swept": " ".join(each["key"] for each in swept.keys)}
    if complete:
        about["control"] = complete[0].attributes.get("control", "")
    names = [name for name in columns if name != "time"]
    held = xarray.Dataset(dict.fromkeys(names, ((), np.nan)), attrs=about)
    own = {name: each for name, each in swept.coordinates.items() if name == "control"}
    chosen = default_columns(held.assign_coords(own))
    first = [*chosen, *names][:1]
    return first + (["friction"] if "friction" in chosen else [*chosen[1:], *names, *first][:1])


def _case(
    case: Listed,
    contents: Contents | None,
    places: list[int],
    how: tuple[Mapping[str, Drawn], Mapping[str, Drawn], Mapping[str, Described]],
) -> dict[str, Any]:
    columns, fields, described = how
    about: dict[str, Any] = {"number": case.number, "at": places, "state": case.state, "reason": case.reason}
    if contents is None:
        unreadable = {"state": "damaged", "reason": f"{case.path.name} is not a complete result file"}
        return about | (unreadable if case.state == "complete" else {})
    placed = PLACED | contents.lists.keys()
    facts = {name: plain(value) for name, value in contents.attributes.items() if name not in placed}
    work = contents.extremes.get("work", 0.0)
    binned = {
        description.dimensions[1] for description in described.values() if len(description.dimensions) == 2
    }
    return about | {
        "rows": contents.rows,
        "residual": plain(contents.extremes.get("residual")) if "residual" in contents.extremes else None,
        "balance": contents.extremes["energy_residual"] / work
        if work and "energy_residual" in contents.extremes
        else None,
        "open": any(line.startswith(UNBALANCED) for line in warnings(contents)),
        "seconds": (seconds := plain(contents.attributes.get("wall_seconds"))),
        "took": "" if seconds is None else duration(float(seconds)),
        "warnings": warnings(contents),
        "facts": facts,
        "lists": [
            {"name": name, "about": described[name].attributes, "values": packed(values)}
            for name, values in contents.lists.items()
            if described[name].dimensions[0] not in binned
        ],
        "columns": {name: columns[name](values) for name, values in contents.columns.items()} or None,
        "surface": None if contents.surfaces is None else _surface(contents.surfaces, fields),
    }


def _surface(surfaces: Surfaces, fields: Mapping[str, Drawn]) -> dict[str, Any]:
    said = [
        f"every {_ordinal(n)} point along {name}"
        for name, n in zip("xy", surfaces.strides, strict=False)
        if n > 1
    ]
    said += [f"{len(surfaces.times)} of {surfaces.among} snapshots"] * (len(surfaces.times) < surfaces.among)
    return {
        "times": (surfaces.times / fields["snapshot"].divisor).tolist(),
        "axes": {name: fields[name](values) for name, values in surfaces.axes.items()},
        "fields": {name: fields[name](values) for name, values in surfaces.fields.items()},
        "note": ", ".join(said),
        "inside": None
        if surfaces.inside is None
        else {
            name: fields[name](values)
            for name, values in zip(("z", "von_mises"), surfaces.inside, strict=True)
        },
    }


def _ordinal(number: int) -> str:
    return f"{number}{({2: 'nd', 3: 'rd'}).get(number, 'th')}"


PROGRAM = ("data.js", "figures.js", "curves.js", "surfaces.js", "distributions.js", "tables.js")
COLOURS = 32  # of a scale; browsers interpolate


def write_report(cases: Sequence[Listed], out: Path, title: str, config: str = "") -> Path:
    """Write the report of a case or a sweep, over an earlier one; return its path.

    It is a page (.html), or the warnings and the table of cases in Markdown (.md) or the table alone (.csv).
    `config` is the configuration; default: the first complete case's.
    """
    check_suffix(out, (".html", ".htm", ".md", ".csv"))
    try:
        out.parent.mkdir(parents=True, exist_ok=True)
        data = payload(cases, config)
        if out.suffix.lower() == ".csv":
            written = summary.as_csv(data)
        elif out.suffix.lower() == ".md":
            written = summary.as_markdown(data, title, ", ".join(_worst(cases)))
        else:
            written = page(data, title, accuracy_section(cases))
        write_text(out, written)
    except OSError as error:
        raise ResultsError(f"{out}: cannot be written: {error.strerror or error}") from error
    return out


def _worst(cases: Sequence[Listed]) -> list[str]:
    """Return the worst accuracy of the cases of a folder in words."""
    sweep = next((case.path.parent.parent for case in cases), Path()) / SWEEP_FILE
    if len(cases) > 0 and cases[0].path.parent.name == "cases" and sweep.is_file():
        with suppress(OSError, KeyError, ResultsError):  # damaged
            return worst_accuracy(sweep)
    return []


def accuracy_section(cases: Sequence[Listed]) -> str:
    """Return a section with the doubts, the worst accuracy of the cases, and the errors if estimated."""
    place, parts = next((case.path.parent.parent for case in cases), Path()), list[str]()
    if worst := _worst(cases):
        parts.append(f'<p class="note">Worst of all cases: {escape(", ".join(worst))}.</p>')
    if (place / FILE).is_file():
        found, picture = open_convergence(place), io.StringIO()
        with suppress(ResultsError), styled():  # of errors that are all zero
            convergence_figure(found.data).savefig(picture, format="svg")
            image = base64.b64encode(picture.getvalue().encode()).decode("ascii")
            parts.append(f'<img alt="errors by column and source" src="data:image/svg+xml;base64,{image}">')
        parts.append(f'<pre tabindex="0">{escape(str(found))}</pre>')
    head = '<section id="accuracy" aria-labelledby="accuracy-title">\n  <h2 id="accuracy-title">Accuracy</h2>'
    head += '\n  <ul id="doubts"></ul>'
    return "\n".join([head, *parts, "</section>"])


def page(data: dict[str, Any], title: str, accuracy: str = "") -> str:
    """Return the page with these data, and a section on their accuracy."""
    from plotly.offline import get_plotlyjs

    here = files(__package__)
    title = title.encode(errors="surrogateescape").decode(errors="replace")  # of a file or folder
    version = provenance()["gfmdlayer_version"]
    about = {
        "title": title,
        "written": f"{now()} by gfmdlayer {version}",
        "colours": _colours(),
        "contact": CONTACT,
    }
    parts = {
        "title": escape(title),
        "accuracy": accuracy,
        "style": (here / "page.css").read_text(encoding="utf-8"),
        "plotly": get_plotlyjs(),
        "data": json.dumps(about | data, allow_nan=False, separators=(",", ":")).replace("<", "\\u003c"),
        "program": "\n".join((here / name).read_text(encoding="utf-8") for name in PROGRAM),
    }
    pieces = (here / "page.html").read_text(encoding="utf-8").split("@@")
    return "".join(parts[piece] if i % 2 else piece for i, piece in enumerate(pieces))


def _colours() -> dict[str, list[str]]:
    """Return the colours of curves, pressure and gap from the least to the largest value."""
    names = {"curves": "viridis", "pressure": PRESSURE_COLOURS, "gap": GAP_COLOURS}
    return {
        use: [to_hex(colormaps[name](i / (COLOURS - 1))) for i in range(COLOURS)]
        for use, name in names.items()
    }
