"""Style of the figures: sizes, fonts, colours, line styles, and the formats of pictures.

A figure is laid out for the columns of a journal; the style `screen` draws the same layout larger, with
sans-serif letters and strong lines, for a talk. Colours run from dark to light, viridis cut before its
yellow, so that they keep their order when printed grey; line styles distinguish curves of similar grey.
"""

from __future__ import annotations

import re
from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

import numpy as np

from gfmdlayer.files.whole import unfinished
from gfmdlayer.results.names import ResultsError

if TYPE_CHECKING:
    from matplotlib.artist import Artist
    from matplotlib.figure import Figure
    from matplotlib.lines import Line2D

    from gfmdlayer.arrays import FloatArray

Columns = Literal[1, 2]
Dashes = Literal["solid"] | tuple[float, tuple[float, ...]]

WIDTH_MM: dict[Columns, float] = {1: 85.0, 2: 175.0}
SUFFIXES = (".png", ".pdf", ".svg")
# Contact has a colour of its own, vermillion. The colour-blind too tell it from the colours of gaps (Okabe &
# Ito, https://jfly.uni-koeln.de/color/), which are pale beside the contact and blue where the gap is wide.
CONTACT, PRESSURE_COLOURS, GAP_COLOURS = "#d55e00", "magma_r", "Blues"
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
    """Settings of matplotlib (rcParams), size relative to the column of a journal, and dots per inch."""

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
    "axes.formatter.useoffset": False,
    "axes.formatter.limits": (-99, 99),  # powers of ten are written with the unit
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
    """Set fonts, ticks and lines within a `with` block, and restore matplotlib's settings after it."""
    import matplotlib as mpl

    with mpl.rc_context(dict(style.settings)):
        yield


def new_figure(columns: Columns, height_mm: float, style: Style = PAPER) -> Figure:
    """Return an empty figure as wide as 1 or 2 columns of a journal, times the scale of the style."""
    from matplotlib.figure import Figure

    unit = style.scale / 25.4
    return Figure(figsize=(WIDTH_MM[columns] * unit, height_mm * unit), layout="constrained")


def check_suffix(path: Path, suffixes: tuple[str, ...] = SUFFIXES) -> None:
    """Raise ResultsError unless the suffix is one of those allowed, by default of the formats of pictures."""
    if path.suffix.lower() not in suffixes:
        raise ResultsError(
            f"{path}: cannot be drawn as {path.suffix or 'no suffix'!r}; use {', '.join(suffixes)}"
        )


def save(figure: Figure, path: Path, style: Style = PAPER) -> None:
    """Write a figure in the format that the suffix names; ResultsError if it cannot be written."""
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        with styled(style), unfinished(path, path.suffix) as part:
            figure.savefig(part, dpi=style.dpi)
    except OSError as error:
        raise ResultsError(f"{path}: cannot be written: {error.strerror or error}") from error


def colours(count: int) -> list[str]:
    """Return `count` colours from dark to light."""
    from matplotlib import colormaps
    from matplotlib.colors import to_hex

    return [to_hex(colour) for colour in colormaps["viridis"](np.linspace(0.0, 0.82, count))]


def line_style(i: int) -> Dashes:
    """Return the line style of curve i; the styles repeat."""
    return LINE_STYLES[i % len(LINE_STYLES)]


def legend_entries(entries: Iterable[tuple[str, str, Dashes]]) -> list[Line2D]:
    """Return the entries of a legend of lines, each given by title, colour and line style."""
    from matplotlib.lines import Line2D

    return [Line2D([], [], color=colour, linestyle=dashes, label=title) for title, colour, dashes in entries]


def legend_above(figure: Figure, entries: Sequence[Artist]) -> int:
    """Draw a legend above the panels, in as many columns as have room; return the number of its rows."""
    from matplotlib import rcParams
    from matplotlib.font_manager import FontProperties

    font = FontProperties(size=rcParams["legend.fontsize"]).get_size_in_points()
    letters = max(
        (len(re.sub(r"\\[a-z]+|[${}\\]", "", str(entry.get_label()))) for entry in entries), default=0
    )
    # A letter is about 0.42 as wide as the font is high; the line before the text and the room have 2.8 more.
    width = font * (0.42 * letters + rcParams["legend.handlelength"] + 2.8)
    rows = -(-len(entries) // max(1, int(figure.get_figwidth() * 72 / width)))
    figure.legend(handles=list(entries), loc="outside upper center", ncols=-(-len(entries) // rows))
    return rows


def highest_row(pressure: FloatArray) -> int:
    """Return the row along x, of a field (x, y), through the highest pressure, the middle one of equals."""
    rows = pressure.max(axis=0)
    equal = np.flatnonzero(rows >= rows.max() - 1e-9 * abs(rows.max()))  # as where surfaces yield
    return int(equal[equal.size // 2])


def spread(count: int, most: int) -> list[int]:
    """Return indices from the first to the last of `count`, evenly spaced, at most `most` of them."""
    return [round(i) for i in np.linspace(0, count - 1, min(most, count)).tolist()]
