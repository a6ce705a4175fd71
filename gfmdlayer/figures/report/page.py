"""The page of a case or a sweep: data, style and program in one HTML file, which needs no network.

The data are in JSON, in the units of the figures: the units of the configuration, or the scales of the paper.
Plotly.js (MIT licence), from the package `plotly`, draws the curves.
"""

from __future__ import annotations

import base64
import json
import math
import re
from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
from html import escape
from importlib.resources import files
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
import xarray
from matplotlib import colormaps
from matplotlib.colors import to_hex

from gfmdlayer.config import ConfigError, load
from gfmdlayer.figures.labels import quantity, symbol
from gfmdlayer.figures.plot_style import CONTACT, GAP_COLOURS, PRESSURE_COLOURS, check_suffix
from gfmdlayer.figures.report.cases import Contents, Described, Listed, Reader, Surfaces
from gfmdlayer.figures.selection import default_columns, value_titles
from gfmdlayer.files.whole import write_text
from gfmdlayer.observables.contact import FEWEST
from gfmdlayer.results.gathering import lay_out
from gfmdlayer.results.provenance import LIBRARIES, now, provenance
from gfmdlayer.results.schema import FIELDS, ResultsError, described_key

if TYPE_CHECKING:
    from numpy.typing import ArrayLike


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
    text = _ACCENT.sub(lambda found: found[2] + _ACCENTS[found[1]], part.replace(r"\,", "\u2009"))
    text = _UPRIGHT.sub(r"\1", _UPRIGHT_INDEX.sub(r"\1{\2}", text))
    text = _SIGN.sub(lambda found: _SIGNS.get(found[1], found[1]), text)
    return _INDEX.sub(_index, escape(text, quote=False)).translate({ord("{"): None, ord("}"): None})


def _index(found: re.Match[str]) -> str:
    """Raise a power in Unicode, which needs no tags, and lower an index by a tag."""
    inner = found[2] or found[3]
    if found[1] == "_":
        return f"<sub>{inner}</sub>"
    return inner.translate(_RAISED) if re.fullmatch(r"[-+0-9]+", inner) else f"<sup>{inner}</sup>"


def packed(values: ArrayLike) -> str:
    """Return numbers as base64 of single precision, little-endian: seven digits."""
    with np.errstate(over="ignore"):
        return base64.b64encode(np.asarray(values, dtype="<f4").tobytes()).decode("ascii")


def plain(value: Any) -> Any:
    """Return an attribute as JSON has it: a number, or text; None for NaN."""
    if isinstance(value, bytes):
        return value.decode(errors="replace")
    if isinstance(value, np.ndarray):
        return ", ".join(str(plain(each)) for each in value.ravel().tolist())
    if isinstance(value, np.generic):
        value = value.item()
    if isinstance(value, float) and not math.isfinite(value):
        return None if math.isnan(value) else str(value)
    return value if isinstance(value, int | float | str) else str(value)


SOFTWARE = ("gfmdlayer_version", "git_commit", "python_version", *(f"{name}_version" for name in LIBRARIES))


def warnings(found: Contents) -> list[str]:
    """Return the doubts about a case, from its file; the last two are otherwise only in a log."""
    said = str(found.attributes.get("warnings", "")).splitlines()
    if 0 < (points := int(found.attributes.get("most_contact_points", FEWEST))) < FEWEST:
        said.append(f"coarse: at most {points} point{'s' * (points > 1)} in contact")
    if found.attributes.get("settled") == 0:
        said.append("not steady at the end")
    return said


def origins(complete: Sequence[Contents]) -> dict[str, str]:
    """Return the values of each attribute of provenance over the cases; times from the first to the last."""
    found: dict[str, str] = {}
    for name in (*SOFTWARE, "hostname"):
        values = dict.fromkeys(str(each.attributes[name]) for each in complete if name in each.attributes)
        if values:
            found[name.replace("_", " ")] = ", ".join(values)
    for name, choose in (("started", min), ("finished", max)):
        if every := [str(each.attributes[name]) for each in complete if name in each.attributes]:
            found[name] = choose(every)
    seconds = [float(each.attributes.get("wall_seconds", 0.0)) for each in complete]
    if seconds:
        found["seconds, all cases"] = f"{sum(seconds):.4g}"
    return found


def notes(cases: Sequence[Listed], complete: Sequence[Contents]) -> dict[str, str]:
    """Return notes on the curves and surfaces that the page leaves out."""
    drawn = [each for each in complete if each.columns]
    thinned = [each for each in drawn if len(each.columns["time"]) < each.rows]
    found = {"curves": "", "surfaces": ""}
    if len(drawn) < len(complete):
        found["curves"] = f"The page shows the curves of {len(drawn)} of {len(complete)} complete cases. "
    if thinned:
        widest = max(thinned, key=lambda each: each.rows)
        found["curves"] += (
            f"The page shows up to {len(widest.columns['time'])} of {widest.rows} rows of a case."
        )
    have = sum(int(each.attributes.get("snapshots", 0)) > 0 for each in complete)
    held = sum(each.surfaces is not None for each in complete)
    if held < have:
        found["surfaces"] = f"The page shows the surfaces of {held} of {len(cases)} cases."
    return found


SCALES = ("L", "G0", "tau")
# Attributes that have a place of their own on the page.
PLACED = {
    *("config", "digest", "hostname", "started", "finished", "wall_seconds", "rows", "snapshots", "complete"),
    *(*SOFTWARE, *SCALES, "name", "warnings", "settled", "coordinates"),
}


class Drawn(NamedTuple):
    """How a variable is drawn: the label of its axis, and the divisor of the values in the file."""

    label: str
    divisor: float

    @classmethod
    def of(cls, name: str, attributes: Mapping[str, str], scales: Mapping[str, Any], largest: float) -> Drawn:
        """Return it for values up to `largest`: the power of ten goes with the unit, if it has one."""
        found = quantity(xarray.DataArray(np.nan, name=name, attrs=dict(attributes)), scales)
        found = found.fit([largest / found.scale]) if found.unit else found
        return cls(html(found.label), found.scale * 10.0**found.power)

    def __call__(self, values: Any) -> str:
        """Return values as the page holds them."""
        return packed(np.asarray(values) / self.divisor)


class Swept(NamedTuple):
    """The swept keys as the page has them, their coordinates, and for each case the places of its values."""

    keys: list[dict[str, Any]]
    coordinates: dict[str, xarray.DataArray]
    places: list[list[int]]


def payload(cases: Sequence[Listed], config: str = "") -> dict[str, Any]:
    """Read the cases, and return the data of their page for `json.dumps`; see `write_report`."""
    reader = Reader(cases)
    contents = [reader.read(case) if case.state == "complete" else None for case in cases]
    complete = [each for each in contents if each is not None]
    scales = {
        name: complete[0].attributes[name]
        for name in SCALES
        if complete and len({each.attributes.get(name) for each in complete}) == 1
        if name in complete[0].attributes
    }
    unit: Callable[[str], str] = str
    with suppress(ConfigError, LookupError):  # no case, or one of an earlier version
        unit = load("", content=str(complete[0].attributes["config"])).unit
    swept = _swept(cases, unit)
    described = reader.described
    columns, fields = (find(complete, described, scales) for find in (_columns, _fields))
    listed = [
        _case(case, found, places, (columns, fields, described))
        for case, found, places in zip(cases, contents, swept.places, strict=True)
    ]
    return {
        "keys": swept.keys,
        "columns": [
            {"name": name, "label": drawn.label, "meaning": described[name].attributes.get("long_name", "")}
            | _bins(name, described, complete, scales)
            for name, drawn in columns.items()
        ],
        "shown": _shown_first(columns, complete, swept),
        "fields": {name: drawn.label for name, drawn in fields.items()},
        "cases": listed,
        "config": config or next((str(each.attributes.get("config", "")) for each in complete), ""),
        "provenance": origins(complete),
        "notes": notes(cases, complete),
    }


def _swept(cases: Sequence[Listed], unit: Callable[[str], str]) -> Swept:
    keys = list(dict.fromkeys(key for case in cases for key in case.values))
    layout = lay_out([case.values for case in cases], keys, listed=True)
    found, coordinates, places = [], {}, []
    for name, each in layout.labels.items():
        labels, inverse = np.unique(each.values, return_inverse=True)
        if each.values.dtype.kind == "U":  # in the order of the configuration
            order = list(dict.fromkeys(each.values.tolist()))
            labels, inverse = np.array(order), np.array([order.index(text) for text in each.values])
        coordinate = xarray.DataArray(labels, dims=name, name=name, attrs=described_key(each.key, unit))
        titles = [html(title) for title in value_titles(coordinate)]
        is_number = each.values.dtype.kind in "if"
        found.append(
            {
                "key": each.key,
                "symbol": html(symbol(coordinate)),
                "meaning": coordinate.attrs.get("long_name", each.key),
                "titles": titles,
                "values": [plain(value) for value in labels.tolist()] if is_number else None,
            }
        )
        coordinates[name] = coordinate
        places.append(inverse.tolist())
    by_case = [list(each) for each in zip(*places, strict=True)] if places else [[] for _ in cases]
    return Swept(found, coordinates, by_case)


def _columns(
    complete: Sequence[Contents], described: Mapping[str, Described], scales: Mapping[str, Any]
) -> dict[str, Drawn]:
    """Return all columns that any case has, time first."""
    names = dict.fromkeys(["time", *(name for each in complete for name in sorted(each.columns))])
    largest = {name: max((each.extremes.get(name, 0.0) for each in complete), default=0.0) for name in names}
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
        return max((float(np.nanmax(np.abs(each))) for each in every if each is not None), default=0.0)

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
        ([each.lists[end] for end in both] for each in complete if each.lists.keys() >= {*both}), None
    )
    if ends is None:
        return {}
    edges = np.append(ends[0], ends[1][-1])
    largest = float(np.abs(edges[np.isfinite(edges)]).max())
    drawn = Drawn.of(along.removesuffix("_bin"), described[along].attributes, scales, largest)
    edges = edges / drawn.divisor
    return {"bins": {"label": drawn.label, "edges": [plain(edge) for edge in edges.tolist()]}}


def _shown_first(columns: Mapping[str, Drawn], complete: Sequence[Contents], swept: Swept) -> list[str]:
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
    found: Contents | None,
    places: list[int],
    how: tuple[Mapping[str, Drawn], Mapping[str, Drawn], Mapping[str, Described]],
) -> dict[str, Any]:
    columns, fields, described = how
    about: dict[str, Any] = {"number": case.number, "at": places, "state": case.state, "reason": case.reason}
    if found is None:
        unreadable = {"state": "damaged", "reason": f"{case.path.name} is not a complete result file"}
        return about | (unreadable if case.state == "complete" else {})
    placed = PLACED | found.lists.keys()
    facts = {name: plain(value) for name, value in found.attributes.items() if name not in placed}
    work = found.extremes.get("work", 0.0)
    binned = {each.dimensions[1] for each in described.values() if len(each.dimensions) == 2}
    return about | {
        "rows": found.rows,
        "residual": plain(found.extremes.get("residual")) if "residual" in found.extremes else None,
        "balance": found.extremes["energy_residual"] / work
        if work and "energy_residual" in found.extremes
        else None,
        "seconds": plain(found.attributes.get("wall_seconds")),
        "warnings": warnings(found),
        "facts": facts,
        "lists": [
            {"name": name, "about": described[name].attributes, "values": packed(values)}
            for name, values in found.lists.items()
            if described[name].dimensions[0] not in binned
        ],
        "columns": {name: columns[name](values) for name, values in found.columns.items()} or None,
        "surface": None if found.surfaces is None else _surface(found.surfaces, fields),
    }


def _surface(found: Surfaces, fields: Mapping[str, Drawn]) -> dict[str, Any]:
    said = [
        f"every {_ordinal(n)} point along {name}"
        for name, n in zip("xy", found.strides, strict=False)
        if n > 1
    ]
    said += [f"{len(found.times)} of {found.among} snapshots"] * (len(found.times) < found.among)
    return {
        "times": (found.times / fields["snapshot"].divisor).tolist(),
        "axes": {name: fields[name](values) for name, values in found.axes.items()},
        "fields": {name: fields[name](values) for name, values in found.fields.items()},
        "note": ", ".join(said),
        "inside": None
        if found.inside is None
        else {
            name: fields[name](values) for name, values in zip(("z", "von_mises"), found.inside, strict=True)
        },
    }


def _ordinal(number: int) -> str:
    return f"{number}{({2: 'nd', 3: 'rd'}).get(number, 'th')}"


PROGRAM = ("data.js", "figures.js", "curves.js", "surfaces.js", "distributions.js", "tables.js")
COLOURS = 32  # of a scale; browsers interpolate


def write_report(cases: Sequence[Listed], out: Path, title: str, config: str = "") -> Path:
    """Write the page (.html) of a case or a sweep, over an earlier one; return its path.

    `config` is the configuration; default: the first complete case's.
    """
    check_suffix(out, (".html", ".htm"))
    try:
        write_text(out, page(payload(cases, config), title))
    except OSError as error:
        raise ResultsError(f"{out}: cannot be written: {error.strerror or error}") from error
    return out


def page(data: dict[str, Any], title: str) -> str:
    """Return the page with these data."""
    from plotly.offline import get_plotlyjs

    here = files(__package__)
    version = provenance()["gfmdlayer_version"]
    about = {
        "title": title,
        "written": f"{now()} by gfmdlayer {version}",
        "colours": _colours(),
        "contact": CONTACT,
    }
    parts = {
        "title": escape(title),
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
