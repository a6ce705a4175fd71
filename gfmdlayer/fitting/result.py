"""The result of a fit: its options, estimates and curves; a table, a picture, a dataset.

The names of lmfit, a package for fits by least squares, lead to the same numbers: params, value, stderr,
vary, min, max, chisqr, redchi, ndata, nvarys, nfree, nfev. Its aic and bic differ from these, which are of
the likelihood, by a number that is the same for all models.
"""

from __future__ import annotations

import html
import json
import math
from abc import ABC, abstractmethod
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeAlias

import numpy as np

from gfmdlayer.arrays import BoolArray, FloatArray
from gfmdlayer.config import ConfigError
from gfmdlayer.figures.labels import Quantity, finish, name_axes
from gfmdlayer.figures.plot_style import colours, new_figure, save, styled
from gfmdlayer.fitting.elastic import CHOOSE, KINDS, NO_ADHESION
from gfmdlayer.fitting.force_curve import PRESCRIBED, ForceCurve, numbers_in
from gfmdlayer.fitting.misfit import NOISE_ONLY
from gfmdlayer.fitting.problem import without_effect
from gfmdlayer.results.names import parameter
from gfmdlayer.validation import text
from gfmdlayer.validation.entry import entry

if TYPE_CHECKING:
    import os

    import xarray
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

    from gfmdlayer.validation.units import Units

Table: TypeAlias = tuple[Sequence[str], Sequence[Sequence[str]]]  # headings, and rows of cells

OPEN = 10.0  # ratio of the ends of an interval from which a parameter is not determined
ADHESIONS = (NO_ADHESION, *KINDS, CHOOSE)
# Estimators of the contact point: `detect` starts the fit, the others settle it, see `contact_point`.
ESTIMATORS = ("deviation", "gradient", "constant_line", "constant_polynomial", "line_polynomial")
CONTACTS = ("given", "detect", *ESTIMATORS)
BASELINES = ("none", "offset", "tilt")
LOSSES = ("linear", "soft_l1", "huber", "cauchy")
SHOWN_CURVES = 6


@dataclass(frozen=True)
class FitOptions:
    """How curves are fitted."""

    loss: str = "linear"  # linear; or soft_l1, huber, cauchy, which give outliers less weight
    profile: bool = False  # find profile intervals too; the fit then takes three to ten times as long
    # given: depths count from the surface. detect: each curve has a free contact point and a free offset of
    # the force, which start where the force begins to rise. Estimators: depths count from the contact point
    # that each finds, unless contact_point is free; then the fit starts there.
    contact: str = "given"
    segments: (
        str | Sequence[str]
    ) = ()  # one or several names of the segments whose rows count; all by default
    # Of curves whose files do not name them: the prescribed quantity, and the stiffness of the cantilever, in
    # the units of the model, with its relative standard error.
    prescribed: str | None = None
    stiffness: float | None = None
    stiffness_error: float | None = None
    # none, jkr or dmt, whose work or force is then free, or choose: the best by BIC; the model's by default.
    adhesion: str | None = None
    # Of files without them: the deflection per volt, and the rows in a unit of time, in the model's units.
    sensitivity: float | None = None
    sampling: float | None = None
    # Subtracted before the fit: the mean force of the rows before contact, or their straight line over the
    # position; none by default.
    baseline: str = "none"
    # Residuals count by the distance from the contact point over this length, up to 1; all alike by default.
    weight: float | None = None
    # Lowest and highest depth relative to the contact point of the rows that count.
    range: Sequence[float] | None = None

    def __post_init__(self) -> None:
        problems = []
        names = (self.segments,) if isinstance(self.segments, str) else self.segments
        if not isinstance(names, Iterable) or not all(isinstance(name, str) for name in names):
            problems.append(f"segments: got {self.segments!r}; must be names, such as ('approach', 'hold')")
        else:
            object.__setattr__(self, "segments", tuple(names))
        if self.loss not in LOSSES:
            problems.append(f"loss: got {self.loss!r}; must be one of {', '.join(LOSSES)}")
        if self.contact not in CONTACTS:
            problems.append(f"contact: got {self.contact!r}; must be one of {', '.join(CONTACTS)}")
        if self.baseline not in BASELINES:
            problems.append(f"baseline: got {self.baseline!r}; must be one of {', '.join(BASELINES)}")
        if self.range is not None:
            ends = depths_in(self.range)
            if ends.shape != (2,) or not ends[0] < ends[1]:
                problems.append(f"range: got {self.range!r}; must be two depths, the lower one first")
            else:
                object.__setattr__(self, "range", tuple(ends.tolist()))
        if self.prescribed not in (None, *PRESCRIBED):
            problems.append(f"prescribed: got {self.prescribed!r}; must be one of {', '.join(PRESCRIBED)}")
        if self.adhesion not in (None, *ADHESIONS):  # also of a list, which a set would not take
            problems.append(f"adhesion: got {self.adhesion!r}; must be one of {', '.join(ADHESIONS)}")
        for key in ("stiffness", "stiffness_error", "sensitivity", "sampling", "weight"):
            value = getattr(self, key)
            if value is not None and not (
                isinstance(value, int | float | np.number) and 0 < value < math.inf
            ):
                problems.append(f"{key}: got {value!r}; must be > 0 and finite")
        if problems:
            raise ConfigError(problems)


def depths_in(values: object) -> FloatArray:
    """Return numbers as an array; NaN for anything else."""
    try:
        return np.asarray(values, dtype=float)
    except (TypeError, ValueError):
        return np.array(math.nan)


@dataclass(frozen=True)
class Estimate:
    """A fitted parameter."""

    key: str  # dotted key of the model, or value of a curve
    curve: str  # the curve to which it belongs; empty if all curves share it
    value: float  # least squares
    error: float  # standard error, in the units of the value
    interval: tuple[float, float]  # 95 % confidence interval, linear
    profile: tuple[float, float] | None  # 95 % confidence interval, by profile
    bounds: tuple[float, float]  # smallest and largest value allowed
    relative: bool  # whether it is fitted by its logarithm

    @property
    def name(self) -> str:
        """Key, with the curve to which it belongs."""
        return f"{self.key}[{self.curve}]" if self.curve else self.key

    @property
    def stderr(self) -> float:
        """Standard error, as `error`."""
        return self.error

    @property
    def vary(self) -> bool:
        """True: it is fitted."""
        return True

    @property
    def min(self) -> float:
        """Smallest value allowed."""
        return self.bounds[0]

    @property
    def max(self) -> float:
        """Largest value allowed."""
        return self.bounds[1]

    @property
    def is_open(self) -> bool:
        """Whether the data leave it open: the interval reaches a bound, or spans a factor of ten."""
        (low, high), (least, most) = self.profile or self.interval, self.bounds
        return low <= least or high >= most or (self.relative and high > OPEN * low)

    @property
    def standard_error(self) -> float:
        """Standard error in the units of the value, as `error`."""
        return self.error


@dataclass(frozen=True)
class Held:
    """A number of the model that is not fitted, with the names of an `Estimate`."""

    name: str  # dotted key of the model
    value: float
    stderr: None = None
    vary: bool = False
    min: float = -math.inf
    max: float = math.inf


class Parameters(dict[str, Estimate | Held]):
    """Numbers of a fit, free and held, by their names or the last parts of their keys."""

    def __missing__(self, name: str) -> Estimate | Held:
        """Return the only one whose key ends so, or the only free one."""
        found = [each for key, each in self.items() if key.partition("[")[0].rpartition(".")[2] == name]
        free = [each for each in found if each.vary]
        if len(free or found) != 1:
            raise KeyError(f"{name}: must be one of {', '.join(self)}")
        return (free or found)[0]


@dataclass(frozen=True)
class CurveFit:
    """A curve with the response of the fitted model."""

    curve: ForceCurve  # the measurement
    force: FloatArray  # predicted, at the rows of the curve
    depth: FloatArray  # predicted, at the rows of the curve
    band: FloatArray  # half width of the 95 % confidence band of the measured quantity
    used: BoolArray  # rows whose residuals count
    noise: float  # standard deviation of the force, as given or from the residual; NaN if none is measured
    depth_noise: float  # of the depth
    # The part of the measured less the predicted values that the largest shape which the model cannot make
    # would explain, see `IndentationFit.shape`.
    missing: FloatArray | None = None

    @property
    def residual(self) -> FloatArray:
        """Predicted minus measured values of the measured quantity, shape (rows,)."""
        return np.where(self.curve.by_force, self.depth, self.force) - self.curve.measured


class Fit(ABC):
    """What the results of all fits have: a table in words and for notebooks, a picture, a dataset."""

    @abstractmethod
    def lines(self) -> Iterable[str]:
        """Return what `print` shows."""

    @abstractmethod
    def tables(self) -> Sequence[Table]:
        """Return the tables of numbers: headings, and rows of cells."""

    @abstractmethod
    def sentences(self) -> Iterable[str]:
        """Return the sentences beside the tables, warnings last."""

    @abstractmethod
    def figure(self, names: Sequence[str] = ()) -> Figure:
        """Draw the fit, or of a map of fits some parameters."""

    @abstractmethod
    def to_dataset(self) -> xarray.Dataset:
        """Return the numbers of the fit."""

    def __str__(self) -> str:
        return "\n".join(self.lines())

    def _repr_html_(self) -> str:
        """Return the tables and the sentences for a notebook."""
        return "".join(
            [*map(_in_html, self.tables()), *(f"<p>{html.escape(each)}</p>" for each in self.sentences())]
        )

    @entry(path="out")
    def plot(self, out: str | os.PathLike[str] | None = None, names: str | Sequence[str] = ()) -> Figure:
        """Draw the fit.

        Parameters
        ----------
        out : path-like, optional
            Also writes the picture to this file, .png, .pdf or .svg.
        names : str, or sequence of str
            Of a map of fits, the parameters that are drawn; all by default.

        Returns
        -------
        matplotlib.figure.Figure
        """
        figure = self.figure((names,) if isinstance(names, str) else names)
        if out is not None:
            save(figure, Path(out))
        return figure


def _in_html(table: Table) -> str:
    """Return a table of headings and rows for a notebook."""
    head, rows = table
    lines = [("th", head), *(("td", row) for row in rows)]
    cells = ("".join(f"<{tag}>{html.escape(cell)}</{tag}>" for cell in row) for tag, row in lines)
    return f"<table>{''.join(f'<tr>{row}</tr>' for row in cells)}</table>"


@dataclass(frozen=True)
class IndentationFit(Fit):
    """A fit of one or several curves."""

    parameters: tuple[Estimate, ...]
    correlation: FloatArray  # shape (parameters, parameters), on the scales on which they are fitted
    curves: tuple[CurveFit, ...] = field(repr=False)  # each with all its rows
    deviance: float  # -2 ln of the likelihood
    count: int  # parameters, with an estimated noise
    rows: int
    independent: float  # part of the rows that are independent, by the correlation of the residuals
    warnings: tuple[str, ...]  # parameters that the data do not determine, and odd data
    solutions: int  # number of solved contact problems, each over a whole curve
    config: Any = field(repr=False)  # the model with the fitted values
    start: Mapping[str, float]  # the parameters at which the search started, by name
    options: FitOptions
    adhesion: Mapping[str, str | float] | None = None  # the section of the model with the fitted values
    misfit: tuple[str, ...] = ()  # the warnings that the residuals are not white noise
    alternatives: Mapping[str, float] = field(default_factory=dict)  # BIC of each adhesion that was tried
    shape: str = ""  # the largest shape in the residual that the model cannot make, or nothing

    @property
    def aic(self) -> float:
        """Information criterion of Akaike; smaller is better, for the same curves."""
        return self.deviance + 2 * self.count

    @property
    def bic(self) -> float:
        """Information criterion of Schwarz, with all rows."""
        return self.criterion(1.0)

    def criterion(self, independent: float) -> float:
        """Information criterion of Schwarz where a part of the rows is independent.

        Fits of the same curves are compared with the same part.
        """
        return independent * self.deviance + self.count * math.log(max(independent * self.rows, math.e))

    @property
    def choice(self) -> str:
        """The sentence that compares the kinds of adhesion that were tried, or nothing."""
        return preference(self.alternatives)

    @property
    def held(self) -> dict[str, float]:
        """The numbers of the model that are not fitted, by their dotted keys."""
        free, idle = {each.key for each in self.parameters}, without_effect(self.config)
        data = self.config.model_dump(exclude_none=True) | {"adhesion": self.adhesion or {}}
        every = dict(numbers_in(data))
        return {key: value for key, value in every.items() if key not in free and not key.startswith(idle)}

    @property
    def depth(self) -> float:
        """Largest depth below the contact point, of all curves."""
        points = {
            parameter.curve: parameter.value
            for parameter in self.parameters
            if parameter.key == "contact_point"
        }
        shared = points.get("", 0.0)
        reached = (float(fit.curve.depth.max()) - points.get(fit.curve.name, shared) for fit in self.curves)
        return max(*reached, 0.0)

    @property
    def params(self) -> Parameters:
        """All numbers of the model and the curves, free or held, by name: value, stderr, vary, min, max."""
        found = Parameters({each.name: each for each in self.parameters})
        found.update({key: Held(key, value) for key, value in self.held.items()})
        return found

    @property
    def best_values(self) -> dict[str, float]:
        """The values of `params`."""
        return {name: each.value for name, each in self.params.items()}

    @property
    def ndata(self) -> int:
        """Number of rows that count."""
        return self.rows

    @property
    def nvarys(self) -> int:
        """Number of free parameters."""
        return len(self.parameters)

    @property
    def nfree(self) -> int:
        """Rows less free parameters."""
        return self.ndata - self.nvarys

    @property
    def nfev(self) -> int:
        """Number of solved contact problems, each over a whole curve."""
        return self.solutions

    @property
    def chisqr(self) -> float:
        """Sum of squares of the residuals: over the noise where it is given, else in their own units.

        NaN where depths and forces without a given noise would be added.
        """
        total, kinds = 0.0, set[bool]()
        for each in self.curves:
            for by_force, noise in ((False, each.curve.noise), (True, each.curve.depth_noise)):
                rows = each.used & (each.curve.by_force == by_force)
                total += float(np.sum((each.residual[rows] / (noise or 1.0)) ** 2))
                kinds |= {by_force} if rows.any() and noise is None else set()
        return total if len(kinds) < 2 else math.nan

    @property
    def redchi(self) -> float:
        """`chisqr` over `nfree`."""
        return self.chisqr / max(self.nfree, 1)

    @property
    def follows(self) -> bool:
        """Whether no sign was found that the residual has a shape which the model cannot make."""
        return not any(NOISE_ONLY in each.lower() for each in self.misfit)

    def __getitem__(self, name: str) -> Estimate:
        """Return a parameter by its key, or the last part of its key."""
        for each in self.parameters:
            if name in {each.name, each.key, each.key.rpartition(".")[2]}:
                return each
        raise KeyError(f"{name}: must be one of {', '.join(each.name for each in self.parameters)}")

    def lines(self) -> list[str]:
        """Return the lines of `summary`: values, intervals, units, free or held; warnings below."""
        return summary(self)

    def tables(self) -> list[Table]:
        """Return the table of the parameters."""
        return [table(self)]

    def sentences(self) -> list[str]:
        """Return the title, what the marks mean, the adhesion that was chosen, and warnings."""
        warnings = (f"warning: {each}" for each in self.warnings)
        return [_title(self), *_marked(self), *_choice(self), *warnings]

    def figure(self, names: Sequence[str] = ()) -> Figure:  # noqa: ARG002
        """Draw the curves with the fit, and below them the residuals with the largest shape in them."""
        return fit_figure(self)

    def to_dataset(self) -> xarray.Dataset:
        """Return estimates over `parameter`, and the rows of all curves over `curve` and `row`.

        Returns
        -------
        xarray.Dataset
            value, error, low, high over `parameter`; correlation over `parameter` and `other`; time, depth,
            force, fitted_depth, fitted_force, residual (predicted less measured), band and used over `curve`
            and `row`, NaN behind the end of a shorter curve. `units` where the model has units; the model
            and the warnings are attributes.
        """
        import xarray

        names = [each.name for each in self.parameters]
        numbers = np.array([[each.value, each.error, *each.interval] for each in self.parameters]).T
        data: dict[str, Any] = {
            key: ("parameter", values)
            for key, values in zip(("value", "error", "low", "high"), numbers, strict=True)
        }
        data["correlation"] = ("parameter", "other"), self.correlation
        data["unit"] = (
            "parameter",
            [unit_of_parameter(self.config.units, each.key) for each in self.parameters],
        )
        longest = max(each.curve.time.size for each in self.curves)
        words = {"time": "time", "depth": "length", "force": "force"}
        rows = {
            "time": [each.curve.time for each in self.curves],
            "depth": [each.curve.depth for each in self.curves],
            "force": [each.curve.force for each in self.curves],
            "fitted_depth": [each.depth for each in self.curves],
            "fitted_force": [each.force for each in self.curves],
            "residual": [each.residual for each in self.curves],
            "band": [each.band for each in self.curves],
        }
        for key, columns in rows.items():
            padded = [np.pad(each, (0, longest - each.size), constant_values=np.nan) for each in columns]
            known = words.get(key.removeprefix("fitted_"))
            about = {"units": self.config.unit(known)} if known and self.config.units else {}
            data[key] = ("curve", "row"), np.stack(padded), about
        used = [np.pad(each.used, (0, longest - each.used.size)) for each in self.curves]
        data["used"] = ("curve", "row"), np.stack(used)
        about = {
            "model": text.written(self.config.model_dump(exclude_none=True)),
            "warnings": "\n".join(self.warnings),
            "options": json.dumps(vars(self.options)),
            "aic": self.aic,
            "bic": self.bic,
        }
        named = {"parameter": names, "other": names, "curve": [each.curve.name for each in self.curves]}
        return xarray.Dataset(data, named, about)


NAMES = {"none": "no adhesion", "jkr": "JKR", "dmt": "DMT"}
# Differences of BIC from which they count and are strong (Kass & Raftery, J. Am. Stat. Assoc. 90 (1995) 773).
SAME, STRONG = 2.0, 6.0


def preference(criteria: Mapping[str, float]) -> str:
    """Say which adhesion the data prefer, from the BIC of each kind."""
    if len(criteria) < 2:
        return ""
    (best, least), *others = sorted(criteria.items(), key=lambda item: item[1])
    near = [kind for kind, value in others if value - least < SAME]
    far = [f"{NAMES[kind]} by {value - least:.1f}" for kind, value in others if value - least >= SAME]
    if near:
        known = " and ".join(NAMES[kind] for kind in (best, *near))
        words = f"the data cannot tell {known} apart (BIC differs by less than {SAME:g})"
        return words + (f"; they prefer these to {' and to '.join(far)} in BIC" if far else "")
    clearly = "" if min(value for _, value in others) - least >= STRONG else " weakly"
    return f"the data{clearly} prefer {NAMES[best]} to {' and to '.join(far)} in BIC"


def summary(fit: IndentationFit) -> list[str]:
    """Return lines with the estimates, the noise, the correlations and the warnings."""
    return [
        _title(fit),
        *_table(fit),
        *_marked(fit),
        *_choice(fit),
        *(line for fitted in fit.curves[:SHOWN_CURVES] for line in _curve(fitted)),
        *_correlations(fit),
        *(f"warning: {warning}" for warning in fit.warnings),
    ]


def _curve(fitted: CurveFit) -> Iterator[str]:
    """Yield lines with the segments of a curve, as given or guessed, and its noise."""
    name, guessed = fitted.curve.name, fitted.curve.guessed
    if account := fitted.curve.origin.get("account"):
        yield str(account)
    yield f"segments of {name}: {', '.join(map(str, fitted.curve.segments))}" + (
        f" ({guessed})" if guessed else ""
    )
    noise = {"force": fitted.noise, "depth": fitted.depth_noise}
    words = (f"{value:.4g} of the {key}" for key, value in noise.items() if math.isfinite(value))
    yield f"noise of {name}: {', '.join(words)}"


def _title(fit: IndentationFit) -> str:
    rows = sum(fitted.curve.time.size for fitted in fit.curves)
    number = "1 curve" if len(fit.curves) == 1 else f"{len(fit.curves)} curves"
    parameters = "1 free parameter" if len(fit.parameters) == 1 else f"{len(fit.parameters)} free parameters"
    return f"Fit of {number}, {rows} rows, {parameters}. AIC {fit.aic:.2f}, BIC {fit.bic:.2f}."


_NUMBERS = {"value", "error"}
MARK = "*"  # behind intervals that contain noise only


def _marked(fit: IndentationFit) -> list[str]:
    """Explain the mark of the intervals, if they have it."""
    where = f"; the largest shape in its residual: {fit.shape}" if fit.shape else ""
    return [] if fit.follows else [f"{MARK} the model does not follow the curve{where}; {NOISE_ONLY}"]


def _choice(fit: IndentationFit) -> list[str]:
    return [f"adhesion: {fit.choice}"] if fit.choice else []


def table(fit: IndentationFit) -> tuple[list[str], list[list[str]]]:
    """Return the headings and the cells of a table of all numbers, the free ones first."""
    mark = "" if fit.follows else f" {MARK}"
    unit, rows = partial(unit_of_parameter, fit.config.units), []
    for each in fit.parameters:
        ends = [f"{low:.6g} to {high:.6g}" for low, high in filter(None, (each.interval, each.profile))]
        intervals = [f"{ends[0]}{mark}", *ends[1:]] + [""] * (2 - len(ends))
        rows.append(
            [
                each.name,
                f"{each.value:.6g}",
                f"{each.error:.3g}",
                *intervals,
                unit(each.key),
                "free",
            ]
        )
    rows += [[key, f"{value:.6g}", "", "", "", unit(key), "held"] for key, value in fit.held.items()]
    head = ["parameter", "value", "error", "95 % interval", "95 % profile interval", "unit", ""]
    filled = [c for c in range(len(head)) if c == len(head) - 1 or any(row[c] for row in rows)]
    return [head[c] for c in filled], [[row[c] for c in filled] for row in rows]


_OF_A_CURVE = {
    "contact_point": "length", "drift": "length / time", "force_offset": "force",
    "force_drift": "force / time", "tilt": "force / length", "stiffness": "force / length",
    "adhesion.work": "force / length", "adhesion.force": "force", "adhesion.edge_speed": "length / time",
}  # fmt: skip


def unit_of_parameter(units: Units | None, key: str) -> str:
    """Return the unit of a parameter, nothing where the model has no units."""
    if units is None:
        return ""
    known = None if key in _OF_A_CURVE else parameter(key.replace("[", ".").replace("]", ""))
    words = _OF_A_CURVE.get(key, known.units if known else "1")
    return "" if words == "1" else units.label(words)


def _table(fit: IndentationFit) -> Iterator[str]:
    """Yield the lines of the table: numbers to the right, words to the left."""
    head, rows = table(fit)
    widths = [max(len(row[c]) for row in (head, *rows)) for c in range(len(head))]
    for row in (head, *rows):
        cells = zip(row, widths, head, strict=True)
        words = (
            f"{cell:>{width}}" if name in {"value", "error"} else f"{cell:{width}}"
            for cell, width, name in cells
        )
        yield "  ".join(words).rstrip()


def _correlations(fit: IndentationFit) -> Iterator[str]:
    if len(fit.parameters) < 2 or len(fit.parameters) > 2 * SHOWN_CURVES:
        return
    yield "correlation:"
    for estimate, row in zip(fit.parameters, fit.correlation, strict=True):
        yield "  " + " ".join(f"{value:6.3f}" for value in row) + f"  {estimate.name}"


def fit_figure(fit: IndentationFit) -> Figure:
    """Draw the measured quantities with the fit and its 95 % band over time, and below them the residuals."""
    shown = fit.curves[:SHOWN_CURVES]
    quantities = [
        (name, by_force)
        for name, by_force in (("force", False), ("depth", True))
        if any((fitted.curve.by_force == by_force).any() for fitted in shown)
    ]
    units = fit.config.units
    with styled():
        figure = new_figure(2 if len(quantities) > 1 else 1, 100.0)
        axes = figure.subplots(2, len(quantities), sharex=True, squeeze=False, height_ratios=(2.2, 1))
        for number, ((name, by_force), (above, below)) in enumerate(zip(quantities, axes.T, strict=True)):
            for fitted, colour in zip(shown, colours(len(shown) + 1), strict=False):
                if (fitted.curve.by_force == by_force).any():
                    _draw(above, below, fitted, by_force, colour, fit.shape)
            above.set_title(f"({'abcd'[number]})", loc="left")
            handles, labels = above.get_legend_handles_labels()
            above.legend(handles[:3], labels[:3])
            below.axhline(0, color="black", linewidth=0.5)
            words = {"force": "force", "depth": "length"}[name]
            time, unit = ("" if units is None else units.label(word) for word in ("time", words))
            name_axes(above, y=Quantity(name, unit))
            name_axes(below, Quantity("time", time), Quantity("residual", unit))
            below.set_title(f"({'abcd'[len(quantities) + number]})", loc="left")
        finish(figure)
    return figure


def _draw(above: Axes, below: Axes, curve_fit: CurveFit, by_force: bool, colour: str, shape: str) -> None:
    rows = curve_fit.curve.by_force == by_force
    fitted = np.where(rows, curve_fit.depth if by_force else curve_fit.force, np.nan)  # gaps where prescribed
    measured = np.where(rows, curve_fit.curve.measured, np.nan)
    time, band = curve_fit.curve.time, curve_fit.band
    thin = max(1, time.size // 400)  # more markers would hide the line
    above.plot(time[::thin], measured[::thin], ".", color="0.6", ms=2.2, mew=0, label="measured")
    above.plot(time, fitted, color=colour, linewidth=1.0, label="fitted")
    above.fill_between(time, fitted - band, fitted + band, color=colour, alpha=0.3, lw=0, label="95 % band")
    residual = np.where(curve_fit.used, measured - fitted, np.nan)
    below.plot(time[::thin], residual[::thin], ".", color=colour, ms=1.8, mew=0)
    if curve_fit.missing is not None:
        missing = np.where(rows & curve_fit.used, curve_fit.missing, np.nan)
        label = "_nolegend_" if below.get_legend() else shape
        below.plot(time, missing, color="black", linewidth=0.8, label=label)
        below.legend()
    below.fill_between(time, -band, band, where=rows, color=colour, alpha=0.3, lw=0)
