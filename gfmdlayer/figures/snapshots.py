"""Pictures of the surface at the snapshot times, zoomed to the contact.

A line contact is drawn as profiles of displacement and pressure, a surface in two dimensions as maps of
pressure and gap with a cut through both. Colours cover all snapshots, also those for which there is no room;
maps are read one at a time, and thinned to the dots of a picture.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import ExitStack, contextmanager
from itertools import product
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from matplotlib import colormaps, rcParams
from matplotlib.lines import Line2D

from gfmdlayer.figures.curve_family import LEGEND_MOST, ColourBar
from gfmdlayer.figures.labels import explained, finish, name_axes, quantity, symbol
from gfmdlayer.figures.plot_style import (
    CONTACT,
    GAP_COLOURS,
    PAPER,
    PRESSURE_COLOURS,
    Style,
    colours,
    highest_row,
    legend_above,
    legend_entries,
    line_style,
    new_figure,
    spread,
    styled,
)
from gfmdlayer.figures.selection import case_titles
from gfmdlayer.results.names import ResultsError
from gfmdlayer.results.reader import case_path, is_complete, open_case

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure
    from matplotlib.image import AxesImage
    from numpy.typing import ArrayLike
    from xarray import DataArray, Dataset

    from gfmdlayer.arrays import FloatArray
    from gfmdlayer.figures.labels import Quantity


# Selection of the surfaces to draw: cases with snapshots, their times, cuts, the extent of the contact.

Window = Mapping[str, tuple[float, float]]  # the part of each axis that is shown

# Of the largest pressure: a solver may leave less than its tolerance where there is no contact.
NOTICEABLE = 1e-4


@contextmanager
def cases_with_snapshots(
    path: Path, results: Dataset, number: int | None, most: int
) -> Iterator[dict[str, Dataset]]:
    """Open complete cases that have snapshots, as title -> case, for a `with` block.

    `results` are the contents of the folder or file at `path`, or a selection of its cases. By default all of
    them are opened, or `most` of them from the first to the last; with `number`, this case.
    """
    if "case" not in results.coords:
        if number:
            raise ResultsError(f"{path}: there is no case {number}; must be 0, the only one")
        yield {"": results} if results.sizes["snapshot"] else {}
        return
    numbers = results["case"].to_numpy().ravel().tolist()
    if number is not None and number not in numbers:
        raise ResultsError(f"{path}: there is no case {number}; must be from 0 to {max(numbers)}")
    titled = zip(case_titles(results).values(), numbers, strict=True)
    wanted = [(title, index) for title, index in titled if number is None or index == number]
    complete = [(title, index) for title, index in wanted if is_complete(case_path(path, index))]
    if number is not None and not complete:
        raise ResultsError(f"{path}: case {number} is not complete")
    opened: dict[str, Dataset] = {}
    with ExitStack() as stack:
        for title, index in [complete[i] for i in spread(len(complete), most)]:
            own = f"{title}, case {index:04d}" if title in opened else title
            case = stack.enter_context(open_case(case_path(path, index)))
            opened[own] = case.assign_coords(case=index)
        yield {title: case for title, case in opened.items() if case.sizes["snapshot"]}


def of_one_kind(cases: dict[str, Dataset]) -> tuple[dict[str, Dataset], str]:
    """Return the cases whose contact is along a line, or on a surface, as the first; words on the others."""
    on_surface = "y" in next(iter(cases.values())).dims if cases else False
    alike = {title: case for title, case in cases.items() if ("y" in case.dims) == on_surface}
    if len(alike) == len(cases):
        return cases, ""
    other = "along a line" if on_surface else "on a surface"
    return alike, f" (others are contacts {other}: --select or --case draws them)"


def at_times(case: Dataset, times: Sequence[float]) -> Dataset:
    """Select the snapshots at some times, in the units of the config; ResultsError if one is missing."""
    present = case["snapshot"].to_numpy()
    for time in times:
        if not np.isclose(present, time, rtol=1e-9, atol=0).any():
            known = ", ".join(f"{each:g}" for each in present)
            raise ResultsError(f"there is no snapshot at time {time:g}; there are {known or 'none'}")
    return case.sel(snapshot=list(times), method="nearest")


def section(case: Dataset) -> Dataset:
    """Cut a surface along x, through its highest pressure at the last snapshot; a line does not change."""
    if "y" not in case.dims:
        return case
    pressure = case["pressure"].isel(snapshot=-1).transpose("x", "y")
    return case.isel(y=highest_row(pressure.to_numpy()))


def snapshot_times(case: Dataset) -> tuple[Quantity, list[float]]:
    """Return how time is drawn, and the times of the snapshots, divided by its scale."""
    time = quantity(case["snapshot"], case.attrs)
    exact, short = ([float(f"{t / time.scale:.{n}g}") for t in case["snapshot"].to_numpy()] for n in (12, 4))
    return time, short if len(set(short)) == len(set(exact)) else exact


def snapshot_titles(case: Dataset) -> list[str]:
    """Return the times of the snapshots, each with the symbol and the unit of time."""
    time, times = snapshot_times(case)
    return time.equals(times)


def touching(case: Dataset) -> DataArray:
    """Return where there is contact, as the run found it: the punch slips or sticks there, the gap is zero.

    Beside an attraction the pressure does not say: it is that of the wall less the traction across the gap.
    """
    slip = case.get("slip_velocity_x")
    return case["gap"] <= 0 if slip is None else slip.notnull()


def part_of(case: Dataset, most: int) -> tuple[Dataset, list[str]]:
    """Return at most so many of the snapshots, from the first to the last, and a note on those left out."""
    count = case.sizes["snapshot"]
    if count <= most:
        return case, []
    return case.isel(snapshot=spread(count, most)), [f"{most} of {count} snapshots"]


class Extremes(NamedTuple):
    """Ends of the pressure over all snapshots of some cases, and the part of each axis around the contact."""

    peak: float
    least: float  # 0 without attraction
    view: Window

    @classmethod
    def of(cls, cases: Iterable[Dataset]) -> Extremes:
        """Read every snapshot of the cases, all on one grid."""
        every = list(cases)
        names = [name for name in "xy" if name in every[0]["pressure"].dims]
        ends: dict[str, list[float]] = {name: [] for name in names}
        peak = least = 0.0
        for one in (case.isel(snapshot=i) for case in every for i in range(case.sizes["snapshot"])):
            pressure = one["pressure"].load()
            highest = max(float(pressure.max()), 0.0)
            peak, least = max(peak, highest), min(least, float(pressure.min()))
            touched = touching(one) if "gap" in one else pressure > NOTICEABLE * highest
            for name in names:
                inside = touched.any([dim for dim in touched.dims if dim != name]).to_numpy()
                ends[name] += one[name].to_numpy()[inside][[0, -1]].tolist() if inside.any() else []
        view = {name: _shown(every[0][name].to_numpy(), ends[name]) for name in names}
        # A solver may leave less tension than its tolerance where nothing attracts.
        return cls(peak or float(not least), least if least < -NOTICEABLE * peak else 0.0, view)

    @property
    def pressures(self) -> tuple[float, float]:
        """Ends of an axis of pressure."""
        room = 0.05 * (self.peak - self.least)
        return self.least - room if self.least else 0.0, self.peak + room


def _shown(coordinate: FloatArray, ends: list[float]) -> tuple[float, float]:
    start, stop = float(coordinate[0]), float(coordinate[-1])
    if not ends:
        return start, stop
    margin = 0.5 * (max(ends) - min(ends)) + 4.0 * float(coordinate[1] - coordinate[0])
    return max(start, min(ends) - margin), min(stop, max(ends) + margin)


def limits(field: DataArray) -> tuple[float, float]:
    """Return the least and the largest value over all snapshots, of which one at a time is in memory."""
    found = [(float(one.min()), float(one.max())) for one in each_snapshot(field)]
    return min(low for low, _ in found), max(high for _, high in found)


def each_snapshot(field: DataArray) -> Iterator[DataArray]:
    """Yield the field of each snapshot, read when it comes."""
    for i in range(field.sizes["snapshot"]):
        yield field.isel(snapshot=i).load()


MOST_CASES = 6
MOST_PROFILES = 60  # of a line contact
MOST_MAPS = 4  # beside each other
MOST_ROWS = 2  # of maps of a single case
MAP_POINTS = 1024  # along each axis of a map: more than its dots in print
MAPS_MM = 150.0  # width of a row of maps
PUNCH: dict[str, Any] = {"color": "0.4", "linestyle": (0, (4, 2))}


def snapshots_figure(
    cases: Dataset | Mapping[str, Dataset],
    style: Style = PAPER,
    notes: Sequence[str] = (),
    *,
    every: bool = False,
) -> Figure:
    """Draw the snapshots of a case, or of cases whose grids have the same number of dimensions.

    Line contacts have a row of two panels for each case, displacement and pressure, with a curve for each
    snapshot. A single case in two dimensions is drawn as maps of pressure and gap, with punch, surface and
    pressure along a cut; several cases as rows of pressure maps.

    Parameters
    ----------
    cases : xarray.Dataset, or mapping of str to xarray.Dataset
        A case with snapshots, as `gfmdlayer.run` and `open_case` return it; or titles and cases.
    style : Style
        Sizes and fonts.
    notes : sequence of str
        Lines below the figure.
    every : bool
        Whether all of very many snapshots are drawn; otherwise a note says how many are.

    Returns
    -------
    matplotlib.figure.Figure
        The picture, which `savefig` writes.
    """
    from xarray import Dataset

    if isinstance(cases, Dataset):
        cases = {"": cases}
    with styled(style):
        first, names = next(iter(cases.values())), ["displacement", "pressure"]
        is_line, is_single = "y" not in first["pressure"].dims, len(cases) == 1 and "gap" in first
        most = MOST_PROFILES if is_line else MOST_MAPS * (MOST_ROWS if is_single else 1)
        parts = {
            title: part_of(case, case.sizes["snapshot"] if every else most) for title, case in cases.items()
        }
        drawn = {title: part for title, (part, _) in parts.items()}
        if is_line:
            figure = _profiles(drawn, style)
        elif is_single:
            names.append("gap")
            figure = _surface(next(iter(cases)), next(iter(drawn.values())), Extremes.of([first]), style)
        else:
            names = ["pressure"]
            figure = _maps(drawn, Extremes.of(cases.values()), style)
        left_out = dict.fromkeys(note for _, said in parts.values() for note in said)
        finish(figure, [*explained(first, names, cases), *notes, *left_out])
    return figure


def _profiles(cases: Mapping[str, Dataset], style: Style) -> Figure:
    """Draw displacement and pressure of line contacts; a time has the same look in all of them."""
    figure = new_figure(2, 22.0 + 38.0 * len(cases), style)
    panels = figure.subplots(len(cases), 2, sharex=True, sharey="col", squeeze=False)
    times = sorted({time for case in cases.values() for time in snapshot_times(case)[1]})
    clock = snapshot_times(next(iter(cases.values())))[0]
    bar = ColourBar.of(times, clock) if len(times) > LEGEND_MOST else None
    shades = bar.colours if bar else colours(len(times))
    looks = {
        time: (shade, line_style(0 if bar else i))
        for i, (time, shade) in enumerate(zip(times, shades, strict=True))
    }
    seen = Extremes.of(cases.values())
    left, right = seen.view["x"]
    for row, (title, case) in zip(panels, cases.items(), strict=True):
        part = case.sel(x=slice(left, right))
        along = part["x"].to_numpy() / quantity(case["x"], case.attrs).scale
        for axes, name in zip(row, ("displacement", "pressure"), strict=True):
            up = quantity(case[name], case.attrs)
            for i, time in enumerate(snapshot_times(case)[1]):
                (shade, dashes), one = looks[time], part.isel(snapshot=i)
                values = one[name].to_numpy() / up.scale
                axes.plot(along, values, color=shade, linestyle=dashes)
                if name == "displacement" and "gap" in one:
                    few = len(looks) <= LEGEND_MOST
                    mark_contact(axes, along, values, touching(one), 3.0 if few else 1.8)
            name_axes(axes, y=up)
        row[0].set_title(title, loc="left")
    x, p = quantity(case["x"], case.attrs), quantity(case["pressure"], case.attrs)
    for axes in panels[-1]:
        axes.set_xlim(left / x.scale, right / x.scale)
        name_axes(axes, x)
    panels[0, 1].set_ylim(np.divide(seen.pressures, p.scale))
    entries = []
    if bar is not None:
        bar.draw(figure, panels)
    else:
        entries = legend_entries(
            (title, *look) for title, look in zip(clock.equals(times), looks.values(), strict=True)
        )
    if any("gap" in case for case in cases.values()):
        entries.append(contact_entry())
    if entries:
        legend_above(figure, entries)
    return figure


def contact_entry(times: float = 3.0) -> Line2D:
    """Return the entry of a legend for the contact: a line in its colour, `times` as broad as others."""
    width = times * rcParams["lines.linewidth"]
    look: dict[str, Any] = {"marker": "o", "markersize": width, "markeredgewidth": 0}  # for a single point
    return Line2D([], [], color=CONTACT, linewidth=width, label="contact", zorder=1, **look)


def mark_contact(axes: Axes, x: FloatArray, u: FloatArray, touched: ArrayLike, times: float = 3.0) -> Line2D:
    """Draw the part of a surface in contact, as a broad line below it."""
    line = contact_entry(times)
    line.set_data(x, np.where(touched, u, np.nan))
    axes.add_line(line)
    return line


def _maps(cases: Mapping[str, Dataset], seen: Extremes, style: Style) -> Figure:
    """Draw rows of pressure maps for each case."""
    most = max(case.sizes["snapshot"] for case in cases.values())
    columns, lines = min(most, MOST_MAPS), -(-most // MOST_MAPS)
    height = height_of_map(columns, seen.view)
    figure = new_figure(2, 14.0 + (9.0 + height) * len(cases) * lines, style)
    panels = figure.subplots(len(cases) * lines, columns, sharex=True, sharey=True, squeeze=False)
    for k, (title, case) in enumerate(cases.items()):
        rows = panels[lines * k : lines * (k + 1)]
        fields = zip(each_snapshot(case["pressure"]), snapshot_titles(case), strict=True)
        for axes, (field, time) in zip(rows.flat, fields, strict=False):
            mesh = draw_map(axes, case, field, seen.view, (seen.least, seen.peak))
            axes.set_title(time, loc="right")
        for axes in rows.flat[case.sizes["snapshot"] :]:
            axes.set_axis_off()
        for row in rows:
            if shown := [axes for axes in row if axes.axison]:
                draw_bar(shown[-1], mesh, quantity(case["pressure"], case.attrs))
                name_axes(row[0], y=quantity(case["y"], case.attrs))
        rows[0, 0].set_title(f"{title}\n", loc="left")
    for axes in panels[-1]:
        name_axes(axes, quantity(case["x"], case.attrs))
    return figure


def _surface(title: str, case: Dataset, seen: Extremes, style: Style) -> Figure:
    """Draw maps of pressure and gap of one case, with cuts below."""
    cut, count = section(case), case.sizes["snapshot"]
    gap = limits(case["gap"].sel({name: slice(*seen.view[name]) for name in "xy"}))[1] or 1.0
    rows = -(-count // MOST_MAPS)
    columns = -(-count // rows)
    height = height_of_map(columns, seen.view)
    figure = new_figure(2, 18.0 + (2 * height + 74.0) * rows, style)
    ratios = (height, height, 30.0, 30.0) * rows
    panels = figure.subplots(
        4 * rows, columns, sharex=True, sharey="row", squeeze=False, height_ratios=ratios
    )
    x, y, u, p = (quantity(case[name], case.attrs) for name in ("x", "y", "displacement", "pressure"))
    ranges = {"pressure": (seen.least, seen.peak), "gap": (0.0, gap)}
    surface = np.array(heights(limits(cut["displacement"]))) / u.scale
    middle, across = float(cut["y"]), (cut["x"] / x.scale).to_numpy()
    for i, time in enumerate(snapshot_titles(case)):
        row, place = divmod(i, columns)
        column = panels[4 * row : 4 * row + 4, place]
        one, profile = case.isel(snapshot=i), cut.isel(snapshot=i)
        meshes = []
        for axes, name in zip(column, ranges, strict=False):
            meshes.append(draw_map(axes, case, one[name].load(), seen.view, ranges[name]))
            axes.axhline(middle / y.scale, color="0.4", linewidth=0.6, linestyle=(0, (4, 3)))
        profile_u = (profile["displacement"] / u.scale).to_numpy()
        column[2].plot(across, profile_u, color=colours(1)[0])
        column[2].plot(across, profile_u + (profile["gap"] / u.scale).to_numpy(), **PUNCH)
        mark_contact(column[2], across, profile_u, touching(profile))
        column[3].plot(across, profile["pressure"] / p.scale, color=colours(1)[0])
        column[0].set_title(time, loc="right")
        column[2].set_ylim(surface)
        column[3].set_ylim(np.divide(seen.pressures, p.scale))
        name_axes(column[3], x)
        if place == 0:
            for axes, along in zip(column, (y, y, u, p), strict=True):
                name_axes(axes, y=along)
        column[3].tick_params(labelbottom=True)
        if place == columns - 1:
            for axes, mesh, name in zip(column, meshes, ranges, strict=False):
                draw_bar(axes, mesh, quantity(case[name], case.attrs))
    for axes in panels[-4:, (count - 1) % columns + 1 :].flat:
        axes.remove()
    panels[0, 0].set_title(f"{title}\n" if title else "", loc="left")
    entries = legend_entries(
        [("surface", colours(1)[0], "solid"), ("punch", PUNCH["color"], PUNCH["linestyle"])]
    )
    legend_above(figure, [*entries, contact_entry()])
    return figure


def height_of_map(columns: int, view: Window) -> float:
    """Return the height in mm of the maps of a row."""
    (left, right), (low, high) = view["x"], view["y"]
    return MAPS_MM / max(columns, 2) * min((high - low) / (right - left), 1.5)


def draw_map(
    axes: Axes, case: Dataset, field: DataArray, view: Window, ends: tuple[float, float], cmap: Any = None
) -> AxesImage:
    """Draw a field over the part `view` of the surface, with colours between two `ends`.

    Both are in the units of the case. A closed gap has the colour of the contact; one that is not known,
    beyond the reach of an isolated contact, is white.
    """
    name = {"pressure": PRESSURE_COLOURS, "gap": GAP_COLOURS}.get(str(field.name), "viridis")
    cmap = colormaps.get_cmap(cmap or name).with_extremes(under=CONTACT if field.name == "gap" else None)
    x, y = (quantity(case[name], case.attrs) for name in "xy")
    scale = quantity(field, case.attrs).scale
    mesh = axes.imshow(
        map_values(case, field),
        origin="lower",
        extent=(*ends_of_grid(case["x"], x.scale), *ends_of_grid(case["y"], y.scale)),
        interpolation="nearest",
        vmin=ends[0] / scale,
        vmax=ends[1] / scale,
        cmap=cmap,
    )
    axes.set(aspect="equal", xlim=np.divide(view["x"], x.scale), ylim=np.divide(view["y"], y.scale))
    return mesh


def map_values(case: Dataset, field: DataArray) -> FloatArray:
    """Return the values of a map, with rows along y, thinned to the dots of a picture.

    A closed gap is -1, below all colours.
    """
    thinned = {name: slice(None, None, -(-field.sizes[name] // MAP_POINTS)) for name in "xy"}
    part = field.isel(thinned).transpose("y", "x")
    values: FloatArray = part.to_numpy() / quantity(field, case.attrs).scale
    return np.where(values <= 0, -1.0, values) if field.name == "gap" else values


def ends_of_grid(coordinate: DataArray, scale: float = 1.0) -> tuple[float, float]:
    """Return the ends of the grid along one axis, half a cell beyond its outer points."""
    values = coordinate.to_numpy()
    half = (values[1] - values[0]) / 2
    return float((values[0] - half) / scale), float((values[-1] + half) / scale)


def draw_bar(axes: Axes, mesh: AxesImage, drawn: Quantity) -> None:
    """Draw a colour bar beside a map, as high as the map."""
    bar = axes.figure.colorbar(mesh, cax=axes.inset_axes((1.05, 0.0, 0.06, 1.0)))
    name_axes(bar.ax, y=drawn)


def heights(ends: ArrayLike) -> tuple[float, float]:
    """Return the range of heights to show: the surface, and 0.6 of its range above it, for the punch."""
    low, high = float(np.min(ends)), float(np.max(ends))
    size = (high - low) or 1e-12
    return low - 0.15 * size, high + 0.6 * size


# Punch and surface at chosen times, as an inset of the curves over time.

# Fractions of the panel: the inset, the ticks and labels at its left and below, a line of text above it.
WIDTH, HEIGHT, MARGIN = 0.4, 0.3, 0.03
LEFT, BELOW, LINE = 0.13, 0.13, 0.075


class Inset(NamedTuple):
    """The profile of punch and surface of a case at some times."""

    profile: Dataset  # displacement, pressure and gap along (snapshot, x); coordinate `case` of a sweep

    @classmethod
    def of(cls, case: Dataset, times: Sequence[float]) -> Inset:
        """Cut a case at times of its snapshots; ResultsError without such a snapshot, or without gaps."""
        if "gap" not in case:
            raise ResultsError(
                "the snapshots have no gap, an earlier version wrote them: run the config again"
            )
        return cls(section(at_times(case, times)).load())

    def mark(self, axes: Axes, curves: DataArray) -> None:
        """Draw a dot for each time on the curve of the case."""
        if "case" in curves.coords:
            index = np.argwhere(curves["case"].to_numpy() == int(self.profile["case"]))[0]
            curves = curves.isel(dict(zip(curves["case"].dims, index.tolist(), strict=True)))
        tau, unit = (quantity(each, self.profile.attrs).scale for each in (curves["time"], curves))
        for time, colour in zip(self.profile["snapshot"].to_numpy(), self._colours(), strict=True):
            rows = curves["time"].to_numpy()
            if not np.nanmin(rows) <= time <= np.nanmax(rows):
                continue
            value = float(curves[np.nanargmin(np.abs(rows - time))])
            axes.plot(
                time / tau, value / unit, "o", color=colour, markeredgecolor="white", zorder=3, clip_on=False
            )

    def draw(self, panel: Axes) -> list[str]:
        """Draw the inset where it covers the least of the panel's curves; return notes on its symbols."""
        titles = snapshot_titles(self.profile)
        left, bottom = _emptiest_corner(panel, LEFT + WIDTH, BELOW + HEIGHT + LINE * len(titles))
        axes = panel.inset_axes((left + LEFT, bottom + BELOW, WIDTH, HEIGHT))
        drawn = [quantity(self.profile[name], self.profile.attrs) for name in ("x", "displacement")]
        along, up = (each._replace(words="") for each in drawn)  # words would reach beyond the panel
        x = self.profile["x"].to_numpy() / along.scale
        for i, colour in enumerate(self._colours()):
            one = self.profile.isel(snapshot=i)
            surface, gap = (one[name].to_numpy() / up.scale for name in ("displacement", "gap"))
            axes.plot(x, surface, color=colour)
            axes.plot(x, surface + gap, color=colour, linestyle=(0, (3, 1.5)), alpha=0.7)
            above = 1.02 + (len(titles) - 1 - i) * LINE / HEIGHT
            look: dict[str, Any] = {"color": colour, "ha": "center", "va": "bottom", "fontsize": "x-small"}
            axes.text(0.5, above, titles[i], transform=axes.transAxes, **look)
        ends = np.divide(Extremes.of([self.profile]).view["x"], along.scale)
        axes.set(xlim=ends, ylim=np.divide(heights(self.profile["displacement"]), up.scale))
        name_axes(axes, along, up)
        for axis in (axes.xaxis, axes.yaxis):
            axis.label.set_fontsize("x-small")
            axis.labelpad = 0
        axes.tick_params(which="both", labelsize="x-small")
        axes.locator_params(nbins=3)
        seen = [tick for tick in axes.get_xticks() if ends[0] <= tick <= ends[1]]
        axes.set_xticks(seen[:: max(len(seen) - 1, 1)])  # the outer two: more would run together
        return explained(self.profile, ["displacement"], [symbol(self.profile["displacement"])])

    def _colours(self) -> list[tuple[float, ...]]:
        count = self.profile.sizes["snapshot"]
        return [tuple(colour) for colour in colormaps["inferno"](np.linspace(0.25, 0.8, count))]


def _emptiest_corner(panel: Axes, width: float, height: float) -> tuple[float, float]:
    """Return the lower left corner of a box, in fractions of the panel, that covers the fewest points."""
    to_panel = panel.transData + panel.transAxes.inverted()
    points = [to_panel.transform(np.column_stack(line.get_data())) for line in panel.lines]
    x, y = np.concatenate(points).T

    def covered(corner: tuple[float, float]) -> int:
        left, bottom = corner
        in_width = np.abs(x - left - width / 2) < 0.5 * width + MARGIN
        return int(np.count_nonzero(in_width & (np.abs(y - bottom - height / 2) < 0.5 * height + MARGIN)))

    across, up = (np.linspace(MARGIN, 1 - MARGIN - size, 7).tolist() for size in (width, height))
    return min(product(reversed(across), up), key=covered)


# Pressure profiles through time as a waterfall: one profile for each snapshot, later ones higher up.

OVERLAP = 2.5  # height of the largest profile relative to the distance between profiles
MOST_TICKS = 12


def waterfall_figure(
    case: Dataset, title: str = "", style: Style = PAPER, notes: Sequence[str] = (), *, every: bool = False
) -> Figure:
    """Draw the contact pressure at the times of the snapshots; a surface is cut along x.

    Parameters
    ----------
    case : xarray.Dataset
        A case with snapshots, as `gfmdlayer.run` and `open_case` return it.
    title : str
        Above the figure.
    style : Style
        Sizes and fonts.
    notes : sequence of str
        Lines below the figure.
    every : bool
        Whether all of very many snapshots are drawn; otherwise a note says how many are.

    Returns
    -------
    matplotlib.figure.Figure
        The picture, which `savefig` writes.
    """
    cut, more = part_of(section(case), case.sizes["snapshot"] if every else MOST_PROFILES)
    clock, seconds = snapshot_times(cut)
    clock, count = clock.fit(seconds) if clock.unit else clock, len(seconds)
    times = clock.numbers(seconds)
    along, up = (quantity(cut[name], case.attrs) for name in ("x", "pressure"))
    x = cut["x"].to_numpy() / along.scale
    pressure = cut["pressure"].transpose("snapshot", "x").to_numpy() / up.scale
    left, right = Extremes.of([cut]).view["x"]
    peak = pressure.max() - min(pressure.min(), 0.0)
    scale = OVERLAP / (peak or 1.0)
    with styled(style):
        figure = new_figure(1, 35.0 + min(6.0 * count, 85.0), style)
        axes = figure.subplots()
        for i, colour in enumerate(colours(count)):
            line = i + scale * pressure[i]
            order = 2 + 0.5 * (1 - i / count)  # earlier profiles in front
            axes.fill_between(x, i, line, facecolor="white", edgecolor="none", zorder=order)
            axes.plot(x, line, color=colour, zorder=order)
        ticks = spread(count, MOST_TICKS)
        axes.set_yticks(ticks, [times[i] for i in ticks])
        axes.minorticks_off()
        axes.tick_params(right=False, top=False)
        axes.spines[["right", "top"]].set_visible(False)
        lowest = (np.arange(count) + scale * pressure.min(axis=1)).min()
        axes.set(
            xlim=(left / along.scale, right / along.scale),
            ylim=(min(lowest, 0.0) - 0.3, count - 0.8 + OVERLAP),
        )
        name_axes(axes, along)
        axes.set_ylabel(clock.label)
        axes.set_title(title, loc="left")
        if peak > 0:  # a scale bar as high as a round pressure, right of the panel
            unit = 10.0 ** math.floor(math.log10(peak))
            value = max(step * unit for step in (1, 2, 5) if step * unit <= peak)
            place = axes.get_yaxis_transform()  # x as a fraction of the panel
            base, top = count - 1, count - 1 + scale * value
            axes.vlines(1.03, base, top, color="black", transform=place, clip_on=False)
            axes.text(1.05, (base + top) / 2, up.equals([value])[0], va="center", transform=place)
        finish(figure, [*explained(case, ["pressure"], [title]), *notes, *more])
    return figure
