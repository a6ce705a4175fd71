"""The look of the figures: sizes, colours, line styles, and how swept values are written.

A figure is laid out for the columns of a journal; the style `screen` draws the same layout larger, with the
sans-serif letters and the strong lines that a talk needs. Colours run dark to light, viridis cut before its
yellow, so that they keep their order when printed grey; line styles tell the curves apart where greys are
close.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from fractions import Fraction
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

import numpy as np

from gfmdlayer.files.whole import unfinished
from gfmdlayer.results.schema import PARAMETERS, ResultsError

if TYPE_CHECKING:
    from matplotlib.figure import Figure
    from xarray import DataArray, Dataset

Columns = Literal[1, 2]
Dashes = Literal["solid"] | tuple[float, tuple[float, ...]]

WIDTH_MM: dict[Columns, float] = {1: 85.0, 2: 175.0}
SUFFIXES = (".png", ".pdf", ".svg")
LINE_STYLES: tuple[Dashes, ...] = (
    "solid",
    (0, (6, 1.5)),
    (0, (6, 1.5, 1, 1.5)),
    (0, (2.5, 1.2)),
    (0, (6, 1.5, 1, 1.5, 1, 1.5)),
    (0, (1, 1.2)),
)


@dataclass(frozen=True)
class Style:
    """How figures look: matplotlib's settings, the size relative to a journal's column, dots an inch."""

    settings: Mapping[Any, Any]
    scale: float
    dpi: int


_COMMON = {
    "legend.frameon": False,
    "legend.handlelength": 3.0,
    "legend.labelspacing": 0.35,
    "xtick.minor.visible": True,
    "ytick.minor.visible": True,
    "svg.fonttype": "none",
    "pdf.fonttype": 42,
}
PAPER = Style(
    _COMMON
    | {
        "font.family": "STIXGeneral",
        "mathtext.fontset": "stix",
        "font.size": 9,
        "axes.labelsize": 10,
        "axes.titlesize": 9,
        "axes.linewidth": 0.6,
        "legend.fontsize": 8.5,
        "lines.linewidth": 1.1,
        "lines.markersize": 4.5,
        "xtick.direction": "in",
        "ytick.direction": "in",
        "xtick.top": True,
        "ytick.right": True,
    },
    scale=1.0,
    dpi=300,
)
SCREEN = Style(
    _COMMON
    | {
        "font.family": "DejaVu Sans",
        "mathtext.fontset": "dejavusans",
        "font.size": 14,
        "axes.labelsize": 17,
        "axes.titlesize": 14,
        "axes.linewidth": 1.2,
        "legend.fontsize": 13,
        "lines.linewidth": 2.4,
        "lines.markersize": 9,
        "xtick.major.size": 6,
        "ytick.major.size": 6,
        "xtick.major.width": 1.2,
        "ytick.major.width": 1.2,
        "xtick.minor.size": 3,
        "ytick.minor.size": 3,
    },
    scale=1.75,
    dpi=160,
)
STYLES = {"paper": PAPER, "screen": SCREEN}


@contextmanager
def styled(style: Style = PAPER) -> Iterator[None]:
    """Set fonts, ticks and lines for the block; matplotlib's own settings return after it."""
    import matplotlib as mpl

    with mpl.rc_context(dict(style.settings)):
        yield


def new_figure(columns: Columns, height_mm: float, style: Style = PAPER) -> Figure:
    """Return an empty figure as wide as one or two columns of a journal, times the scale of the style."""
    from matplotlib.figure import Figure

    unit = style.scale / 25.4
    return Figure(figsize=(WIDTH_MM[columns] * unit, height_mm * unit), layout="constrained")


def check_suffix(path: Path) -> None:
    """Raise ResultsError unless the name ends as a known picture format."""
    if path.suffix.lower() not in SUFFIXES:
        raise ResultsError(
            f"{path}: cannot be drawn as {path.suffix or 'no suffix'!r}; use {', '.join(SUFFIXES)}"
        )


def save(figure: Figure, path: Path, style: Style = PAPER) -> None:
    """Write a figure in the format that the suffix names."""
    try:
        with styled(style), unfinished(path, path.suffix) as part:
            figure.savefig(part, dpi=style.dpi)
    except OSError as error:
        raise ResultsError(f"{path}: cannot be written: {error.strerror or error}") from error


def colours(count: int) -> list[str]:
    """Return colours that lighten in order."""
    from matplotlib import colormaps
    from matplotlib.colors import to_hex

    return [to_hex(colour) for colour in colormaps["viridis"](np.linspace(0.0, 0.82, count))]


def line_style(place: int) -> Dashes:
    """Return the line style at a place; they repeat."""
    return LINE_STYLES[place % len(LINE_STYLES)]


def time_axis(dataset: Dataset) -> tuple[str, float]:
    """Return the label of the time axis and the time that it is scaled by: tau where the results have one."""
    tau = dataset.attrs.get("tau")
    return (r"$t$", 1.0) if tau is None else (r"$t/\tau$", float(tau))


def case_titles(results: Dataset) -> dict[tuple[int, ...], str]:
    """Title the case at each place of a sweep by its swept values."""
    numbers = results["case"]
    order = str(results.attrs.get("swept", "")).split()
    swept = [coordinate for coordinate in results.coords.values() if "key" in coordinate.attrs]
    swept.sort(key=lambda coordinate: order.index(coordinate.attrs["key"]))
    spread = [(value_titles(coordinate), numbers.get_axis_num(coordinate.dims[0])) for coordinate in swept]
    return {
        place: ", ".join(titles[place[axis]] for titles, axis in spread)
        for place in np.ndindex(numbers.shape)
    }


def value_titles(coordinate: DataArray) -> list[str]:
    """Write the values of a swept coordinate with its symbol, or its name where it has none."""
    return [f"{symbol(coordinate)} = {label}" for label in value_labels(coordinate.to_numpy().tolist())]


def symbol(coordinate: DataArray) -> str:
    """Write the symbol of a swept coordinate, or its name where it has none."""
    key = str(coordinate.attrs.get("key", coordinate.name))
    return f"${PARAMETERS[key].mathtext}$" if key in PARAMETERS else str(coordinate.name).replace("_", " ")


def value_labels(values: Sequence[object]) -> list[str]:
    """Write values for a legend, all in one manner.

    Fractions are written as such, if every value is a whole number or one: 1/32, or 1/3 given to all
    digits. Infinity is its sign, powers of ten are powers, text stays as it is.
    """
    numbers = [float(str(value)) for value in values if not isinstance(value, str)]
    if len(numbers) < len(values):
        return [str(value) for value in values]
    parts = [_fraction(number) for number in numbers if math.isfinite(number)]
    is_fractional = None not in parts and any(
        part is not None and part.denominator not in (1, 2, 4) for part in parts
    )
    return [_number_label(number, is_fractional) for number in numbers]


def _fraction(number: float) -> Fraction | None:
    """Return the fraction that a number stands for, if it is a plain one."""
    part = Fraction(number).limit_denominator(1024)
    is_binary = part.denominator & (part.denominator - 1) == 0
    is_long = len(repr(abs(number)).strip("0.")) > 10
    return part if float(part) == number and (is_binary or is_long) else None


def _number_label(number: float, is_fractional: bool) -> str:
    if math.isinf(number):
        return r"$\infty$" if number > 0 else r"$-\infty$"
    if is_fractional:
        return str(_fraction(number))
    mantissa, _, exponent = f"{number:.6g}".partition("e")
    if not exponent and (abs(number) < 1e4 or number % 1000):
        return mantissa
    mantissa, _, exponent = f"{number:.5e}".partition("e")
    mantissa = mantissa.rstrip("0").rstrip(".")
    power = f"10^{{{int(exponent)}}}"
    return f"${power}$" if mantissa == "1" else rf"${mantissa}\times {power}$"
