"""How the curves of a sweep differ: by colour, by line style, by a legend or a colour bar.

The first swept key sets the colour, the second the line style; if the second has more values than there are
line styles and the first has not, they change places. Further keys have their middle values. The cases of a
list differ in both. More than LEGEND_MOST values of a numeric key have a colour bar in place of a legend:
logarithmic, linear, or even in the order of the values, by their spread (`Scale`).
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any, Literal, NamedTuple

import numpy as np
from matplotlib.cm import ScalarMappable
from matplotlib.colors import LinearSegmentedColormap, LogNorm, Normalize, to_hex

from gfmdlayer.figures.labels import Quantity, label_places, name_axes, quantity, symbol
from gfmdlayer.figures.plot_style import LINE_STYLES, Dashes, colours, line_style, spread
from gfmdlayer.figures.selection import (
    case_dimensions,
    case_titles,
    chosen,
    failed_numbers,
    swept,
    value_titles,
)
from gfmdlayer.results.names import ResultsError

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure
    from xarray import DataArray, Dataset

LEGEND_MOST = 6
MOST_TICKS = 12  # of a colour bar of values in their order
_LINE = 2.0  # height of a label of a tick, over that of its letters


class Scale(NamedTuple):
    """Position of values of a quantity on an axis or a colour bar."""

    kind: str  # log, linear, or order: evenly, in the order of the values
    positions: Any  # the values as an array, or their places in the order
    ticks: list[int]  # for `order`, the places that are labelled
    labels: list[str]
    quantity: Quantity  # in the power of ten of the labels

    @classmethod
    def of(
        cls,
        values: Sequence[Any],
        drawn: Quantity = Quantity(""),  # noqa: B008
        *,
        log: bool | None = None,
        measured: bool = False,
    ) -> Scale:
        """Find the scale on which the median lies nearest to the middle; text and infinity lie in order.

        With `log` it is logarithmic, or linear, as asked.

        So do values of which one is zero, where a logarithm would suit the others, as colours; not where
        distances are `measured`, along an axis: there equal ones would show a wrong law.
        ResultsError for text, infinity or zero on a scale that must be logarithmic.
        """
        unique = list(dict.fromkeys(values))
        if not any(isinstance(value, str) for value in values):
            unique.sort()
            numbers = np.asarray(values, dtype=float)
            positive = np.array([each for each in unique if each > 0])
            if np.isfinite(numbers).all():
                middle = [_off_middle(each) for each in (np.log(positive), np.asarray(unique))]
                is_log = unique[0] >= 0 and middle[0] < middle[1] if log is None else log
                if unique[0] > 0 or not is_log or (measured and not log):
                    return cls("log" if is_log and unique[0] > 0 else "linear", numbers, [], [], drawn)
            drawn = drawn.fit(unique) if drawn.unit else drawn
        if log:
            raise ResultsError(
                f"log x: {drawn.symbol} has values that are not positive numbers; draw it without"
            )
        places = {value: place for place, value in enumerate(unique)}
        ticks, labels = spread(len(unique), MOST_TICKS), drawn.numbers(unique)
        positions = np.array([places[value] for value in values], dtype=float)
        return cls("order", positions, ticks, [labels[i] for i in ticks], drawn)

    def apply(self, axes: Axes, name: Literal["x", "y"]) -> None:
        """Set the scale, the ticks and the label of an axis."""
        axis = axes.xaxis if name == "x" else axes.yaxis
        if self.kind == "order":
            label_places(axis, self.ticks, self.labels)
            axis.set_label_text(self.quantity.label)
            return
        axes.set(**{f"{name}scale": self.kind})
        name_axes(axes, **{name: self.quantity})


def _off_middle(values: Any) -> float:
    """Return how far the median is from the middle, as a part of the range; of no values, endlessly far."""
    if not len(values):  # of positive numbers, where none is
        return np.inf
    return float(abs(np.median(values) - (values.min() + values.max()) / 2) / (np.ptp(values) or 1.0))


class ColourBar(NamedTuple):
    """A colour bar of values: its colours, quantity and ticks."""

    mappable: ScalarMappable
    scale: Scale

    @classmethod
    def of(cls, values: Sequence[Any], drawn: Quantity) -> ColourBar:
        """Make the colour bar of values."""
        scale = Scale.of(values, drawn)
        norm = (LogNorm if scale.kind == "log" else Normalize)(scale.positions.min(), scale.positions.max())
        return cls(ScalarMappable(norm, LinearSegmentedColormap.from_list("", colours(256))), scale)

    @property
    def colours(self) -> list[str]:
        """Colours of the values."""
        return [to_hex(colour) for colour in self.mappable.to_rgba(self.scale.positions)]

    def draw(self, figure: Figure, panels: Any) -> None:
        """Draw it beside panels."""
        bar = figure.colorbar(self.mappable, ax=panels, aspect=30, pad=0.02)
        if self.scale.kind == "order":
            height = bar.ax.get_window_extent().height * 72 / figure.dpi
            letters = float(bar.ax.yaxis.label.get_fontsize())
            shown = spread(len(self.scale.ticks), max(2, int(height / (_LINE * letters))))
            labels = [self.scale.labels[i] for i in shown]
            bar.set_ticks([self.scale.ticks[i] for i in shown], labels=labels)
            bar.minorticks_off()
            bar.set_label(self.scale.quantity.label)
            return
        name_axes(bar.ax, y=self.scale.quantity)


class DrawnCurve(NamedTuple):
    """A curve: indices of its case along the dimensions of the sweep, and its look."""

    place: dict[str, int]
    colour: str
    dashes: Dashes


class Family(NamedTuple):
    """The curves of a sweep, and their colours, line styles and legend."""

    sweep: Dataset  # without the dimensions of fixed keys
    curves: list[DrawnCurve]  # one for each case
    legend: list[tuple[str, str, Dashes]]  # title, colour, line style
    bar: ColourBar | None  # in place of entries for the colours
    notes: list[str]

    @property
    def written(self) -> list[str]:
        """The texts beside the curves, with the symbols of swept keys."""
        bar = [self.bar.scale.quantity.symbol] if self.bar else []
        return [*(title for title, *_ in self.legend), *bar, *self.notes]


def family(sweep: Dataset, along: str = "") -> Family:
    """Choose colours and line styles of the curves of a sweep, or of a single case.

    A swept key `along` the x axis does not tell curves apart.
    """
    names = [name for name in case_dimensions(sweep) if name != along]
    if names == ["case"]:
        return _of_list(sweep)
    varied = [name for name in names if sweep.sizes[name] > 1][:2]
    for name in names:
        if name not in varied:
            sweep = chosen(sweep, sweep[name], [sweep.sizes[name] // 2])
    names = varied
    if not names:
        return Family(sweep, [DrawnCurve({}, colours(1)[0], line_style(0))], [], None, [])
    if len(names) == 2 and sweep.sizes[names[1]] > len(LINE_STYLES) >= sweep.sizes[names[0]]:
        names.reverse()
    if len(names) == 2 and sweep.sizes[names[1]] > len(LINE_STYLES):
        sweep = chosen(sweep, sweep[names[1]], spread(sweep.sizes[names[1]], len(LINE_STYLES)))
    return _of_product(sweep, names)


def _of_product(sweep: Dataset, names: list[str]) -> Family:
    """Distinguish the values of one key by colour, the values of a second by line style."""
    shades, titles, bar = _coloured(sweep[names[0]])
    if len(names) == 1:
        dashes = [line_style(0 if bar else i) for i in range(len(shades))]
        curves = [DrawnCurve({names[0]: i}, *look) for i, look in enumerate(zip(shades, dashes, strict=True))]
        legend = list(zip(_with_failures(sweep, names[0], titles), shades, dashes, strict=False))
        return Family(sweep, curves, legend, bar, [])
    dashed = value_titles(sweep[names[1]])
    curves = [
        DrawnCurve({names[0]: i, names[1]: j}, shade, line_style(j))
        for i, shade in enumerate(shades)
        for j in range(len(dashed))
    ]
    legend = [(title, shade, line_style(0)) for title, shade in zip(titles, shades, strict=False)]
    legend += [(title, "black", line_style(j)) for j, title in enumerate(dashed)]
    return Family(sweep, curves, legend, bar, [])


def _of_list(sweep: Dataset) -> Family:
    """Distinguish the cases of a list by a numeric key of many values, or each by its title."""
    keys = [key for key in swept(sweep) if len(set(key.to_numpy().tolist())) > 1]
    many = next((key for key in keys if key.dtype.kind in "if" and _has_many(key)), None)
    if many is None:
        titles = _with_failures(sweep, "case", list(case_titles(sweep).values()))
        looks = [(shade, line_style(i)) for i, shade in enumerate(colours(len(titles)))]
        curves = [DrawnCurve({"case": i}, *look) for i, look in enumerate(looks)]
        legend = [(title, *look) for title, look in zip(titles, looks, strict=True)]
        return Family(sweep, curves, legend, None, [])
    shades, _, bar = _coloured(many)
    others = ", ".join(symbol(key) for key in keys if key is not many)
    curves = [DrawnCurve({"case": i}, shade, line_style(0)) for i, shade in enumerate(shades)]
    return Family(sweep, curves, [], bar, [f"also varied: {others}"] * bool(others))


def _has_many(key: DataArray) -> bool:
    return len(set(key.to_numpy().tolist())) > LEGEND_MOST


def _coloured(key: DataArray) -> tuple[list[str], list[str], ColourBar | None]:
    """Return the colours of the values of a key, with titles for a legend or with a colour bar."""
    if key.dtype.kind in "if" and _has_many(key):
        bar = ColourBar.of(key.to_numpy().tolist(), quantity(key))
        return bar.colours, [], bar
    return colours(key.size), value_titles(key), None


def _with_failures(sweep: Dataset, name: str, titles: list[str]) -> list[str]:
    """Mark the titles of values with which every case failed."""
    lost = np.isin(sweep["case"].transpose(name, ...).to_numpy(), list(failed_numbers(sweep)))
    every = np.all(lost.reshape(len(lost), -1), axis=1)
    return [f"{title} (failed)" if failed else title for title, failed in zip(titles, every, strict=False)]
