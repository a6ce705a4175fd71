"""Fields of the snapshots: stick and slip, fluid in the gap, and the stresses below the surface."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np
from matplotlib.colors import ListedColormap
from matplotlib.patches import Patch
from matplotlib.ticker import MaxNLocator

from gfmdlayer.figures.labels import Quantity, explained, finish, name_axes, quantity
from gfmdlayer.figures.plot_style import (
    CONTACT,
    PAPER,
    Style,
    colours,
    legend_above,
    line_style,
    new_figure,
    spread,
    styled,
)
from gfmdlayer.figures.selection import warnings_of
from gfmdlayer.figures.snapshots import (
    MAP_POINTS,
    MOST_MAPS,
    Extremes,
    contact_entry,
    draw_bar,
    draw_map,
    each_snapshot,
    ends_of_grid,
    height_of_map,
    part_of,
    section,
    snapshot_times,
    snapshot_titles,
    touching,
)
from gfmdlayer.history.inside import INVARIANTS, invariants
from gfmdlayer.results.names import BELOW, ResultsError
from gfmdlayer.validation.problems import nearest

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure
    from xarray import DataArray, Dataset

APART, STICK, SLIP = 0, 1, 2
# Okabe & Ito's blue and orange, which the colour-blind tell apart, on white.
STATES = {APART: "white", STICK: "#0072b2", SLIP: "#e69f00"}
_COLOURS = ListedColormap(list(STATES.values()))
SIGNED = "RdBu_r"  # colours on both sides of zero
_CURVES = 6  # of shear traction below the map of a line


def stick_figure(
    case: Dataset, title: str = "", style: Style = PAPER, notes: Sequence[str] = (), *, every: bool = False
) -> Figure:
    """Draw stick, slip and the shear traction at the snapshots: of a line over x and time, else as maps.

    `every` draws all of very many maps of a surface; otherwise a note says how many are drawn.
    """
    if "slip_velocity_x" not in case:
        raise ResultsError("the snapshots have no slip; they are of a case without friction at the interface")
    is_line = "y" not in case["pressure"].dims
    left_out: list[str] = []
    with styled(style):
        if is_line:
            figure = _stick_over_time(case, style)
        else:
            part, left_out = part_of(case, case.sizes["snapshot"] if every else MOST_MAPS)
            figure = _stick_maps(part, Extremes.of([case]), style)
        figure.axes[0].set_title(f"{title}\n" if title and not is_line else title, loc="left")
        patches = [Patch(facecolor=STATES[STICK], label="stick"), Patch(facecolor=STATES[SLIP], label="slip")]
        curves = figure.axes[1].get_legend_handles_labels()[0] if is_line else []
        legend_above(figure, [*patches, *curves])
        finish(figure, [*explained(case, ["shear_x"], [title]), *notes, *left_out])
    return figure


def states(case: Dataset) -> DataArray:
    """Return APART, STICK or SLIP at each point of the snapshots of a case."""
    slips = (case[name] for name in ("slip_velocity_x", "slip_velocity_y") if name in case)
    moving = sum(abs(each.fillna(0.0)) for each in slips) > 0  # nowhere but in contact
    found: DataArray = touching(case) * STICK + moving * (SLIP - STICK)
    return found


def _stick_over_time(case: Dataset, style: Style) -> Figure:
    """Draw a map over x and the order of the snapshots, and some profiles of shear traction below."""
    left, right = Extremes.of([case]).view["x"]
    clock, times = snapshot_times(case)
    clock = clock.fit(times) if clock.unit else clock
    x, t = (quantity(case[name], case.attrs) for name in ("x", "shear_x"))
    figure = new_figure(1, 110.0, style)
    above, below = figure.subplots(2, 1, sharex=True)
    part = case.sel(x=slice(left, right))
    along = part["x"].to_numpy() / x.scale
    shown = states(part).transpose("snapshot", "x").to_numpy()
    above.imshow(
        shown[:, :: -(-shown.shape[1] // MAP_POINTS)],
        origin="lower",
        aspect="auto",
        interpolation="nearest",
        extent=(float(along[0]), float(along[-1]), -0.5, len(times) - 0.5),
        cmap=_COLOURS,
        vmin=APART,
        vmax=SLIP,
    )
    ticks = np.unique(np.linspace(0, len(times) - 1, min(len(times), _CURVES)).astype(int)).tolist()
    above.set_yticks(ticks, clock.numbers([times[i] for i in ticks]))
    above.minorticks_off()
    above.set_ylabel(clock.label)
    for k, (i, shade) in enumerate(zip(ticks, colours(len(ticks)), strict=True)):
        values = part["shear_x"].isel(snapshot=i).to_numpy() / t.scale
        below.plot(along, values, color=shade, linestyle=line_style(k), label=clock.equals([times[i]])[0])
    below.set_xlim(left / x.scale, right / x.scale)
    name_axes(below, x, t)
    return figure


def _stick_maps(case: Dataset, seen: Extremes, style: Style) -> Figure:
    """Draw maps of stick and slip, and of the shear traction along x, at the snapshots."""
    count = case.sizes["snapshot"]
    figure = new_figure(2, 26.0 + 2 * (height_of_map(count, seen.view) + 4.0), style)
    panels = figure.subplots(2, count, sharex=True, sharey=True, squeeze=False)
    largest = float(abs(case["shear_x"]).max()) or 1.0
    x, y = (quantity(case[name], case.attrs) for name in "xy")
    found = states(case).rename("state")
    fields = zip(snapshot_titles(case), each_snapshot(case["shear_x"]), strict=True)
    for i, (time, field) in enumerate(fields):
        draw_map(panels[0, i], case, found.isel(snapshot=i), seen.view, (APART, SLIP), _COLOURS)
        panels[0, i].set_title(time, loc="right")
        mesh = draw_map(panels[1, i], case, field, seen.view, (-largest, largest), SIGNED)
        name_axes(panels[1, i], x)
    for row in panels:
        name_axes(row[0], y=y)
    draw_bar(panels[1, -1], mesh, quantity(case["shear_x"], case.attrs))
    return figure


DECADES = 4  # of the flow that are drawn
STREAM_POINTS = 128  # along each axis, of the field that the streamlines follow


def flow_figure(flow: Dataset, title: str = "", style: Style = PAPER, notes: Sequence[str] = ()) -> Figure:
    """Draw the fluid's pressure and flow of `gfmdlayer.leakage(..., fields=True)`, a column a snapshot."""
    if "fluid_pressure" not in flow:
        raise ResultsError(
            "there are no fields of the fluid; a line has none, a surface has with fields=True"
        )
    whole = flow if "snapshot" in flow.dims else flow.expand_dims(snapshot=[0.0])
    case, more = part_of(whole, MOST_MAPS)
    count, cell = case.sizes["snapshot"], {name: ends_of_grid(case[name]) for name in "xy"}
    with styled(style):
        ratio = float(np.ptp(case["y"].to_numpy()) / np.ptp(case["x"].to_numpy()))
        figure = new_figure(2, 18.0 + 2 * 138.0 / max(count, 2) * min(ratio, 1.5), style)
        panels = figure.subplots(2, count, sharex=True, sharey=True, squeeze=False)
        for i, time in enumerate(snapshot_titles(case) if "snapshot" in flow.dims else [""]):
            one = case.isel(snapshot=i)
            pressure = draw_map(panels[0, i], one, one["fluid_pressure"], cell, (-0.5, 0.5), SIGNED)
            speed = np.hypot(one["flow_x"].to_numpy(), one["flow_y"].to_numpy())
            with np.errstate(divide="ignore"):
                logarithm = one["fluid_pressure"].copy(data=np.log10(speed / (speed.max() or 1.0)))
            streams = draw_map(panels[1, i], one, logarithm, cell, (-DECADES, 0.0), "cividis")
            _draw_streams(panels[1, i], one)
            for axes in panels[:, i]:
                axes.set_facecolor("black")
            panels[0, i].set_title(time, loc="right")
            name_axes(panels[1, i], x=quantity(case["x"], case.attrs))
        draw_bar(panels[0, -1], pressure, Quantity("pressure / drop"))
        draw_bar(panels[1, -1], streams, Quantity("log$_{10}$ flow / largest of the map"))
        for axes in panels[:, 0]:
            name_axes(axes, y=quantity(case["y"], case.attrs))
        panels[0, 0].set_title(f"{title}\n" if title else "", loc="left")
        said = [*notes, "black: contact, and fluid at rest", *more, *warnings_of(flow)]
        finish(figure, [*explained(case, ["fluid_pressure"], [title]), *said])
    return figure


def _draw_streams(axes: Axes, one: Dataset) -> None:
    """Draw streamlines, wider where more flows, if anything flows."""
    x, y = (one[name].to_numpy() / quantity(one[name], one.attrs).scale for name in "xy")
    thin = tuple(-(-n // STREAM_POINTS) for n in (x.size, y.size))
    u, v = (one[name].to_numpy()[:: thin[0], :: thin[1]].T for name in ("flow_x", "flow_y"))
    size = np.hypot(u, v)
    if not size.any():
        return
    still = size < 10.0**-DECADES * size.max()
    u, v = (np.ma.masked_array(each / size.max(), still) for each in (u, v))
    width = 0.25 + 1.2 * np.sqrt(size / size.max())
    axes.streamplot(
        x[:: thin[0]], y[:: thin[1]], u, v,
        color="white", linewidth=width, density=1.6, arrowsize=0.6, broken_streamlines=True,
    )  # fmt: skip
    axes.set(xlim=(x[0], x[-1]), ylim=(y[0], y[-1]))


_MOST_LEAKS = 6  # curves of a panel
_DECADE = 10.0


def leak_figure(flows: Mapping[str, Dataset], style: Style = PAPER, notes: Sequence[str] = ()) -> Figure:
    """Draw the leak rates of `gfmdlayer.leakage`, by the titles of their cases, over time and over pressure.

    A band is the interval of doubt; a dotted curve is the leak if the fluid did not lift the surface.
    """
    along = [name for name in ("snapshot", "pressure_drop") if _most(flows, name) > 1]
    if not along or not all("leak_rate" in flow for flow in flows.values()):
        message = "needs leak rates, and several snapshots or several drops of pressure"
        raise ResultsError(f"a curve of the leak {message}")
    first, said = next(iter(flows.values())), [*notes]
    with styled(style):
        figure = new_figure(2 if len(along) > 1 else 1, 70.0, style)
        for axes, name in zip(figure.subplots(1, len(along), squeeze=False)[0], along, strict=True):
            said += _draw_leaks(axes, flows, name)
            name_axes(axes, quantity(first[name], first.attrs), quantity(first["leak_rate"], first.attrs))
        one_way = "leak_rate_one_way" in first
        said.append("band: interval of doubt" + (", dotted: if the fluid did not lift the surface" * one_way))
        if not one_way:
            said.append("one way: the fluid does not lift the surface")
        finish(figure, [*said, *dict.fromkeys(each for flow in flows.values() for each in warnings_of(flow))])
    return figure


def _most(flows: Mapping[str, Dataset], name: str) -> int:
    return max(flow.sizes.get(name, 1) for flow in flows.values())


def _draw_leaks(axes: Axes, flows: Mapping[str, Dataset], along: str) -> list[str]:
    """Draw the leak over time or pressure, a curve for each value of the other, and return notes."""
    curves = []
    for title, flow in flows.items():
        others = [str(name) for name in flow["leak_rate"].dims if name != along]
        for place in np.ndindex(*(flow.sizes[name] for name in others)):
            one = flow.isel(dict(zip(others, place, strict=True)))
            values = [quantity(one[name], one.attrs).equals([float(one[name])])[0] for name in others]
            curves.append((", ".join(filter(None, [title, *values])), one))
    chosen = [curves[i] for i in spread(len(curves), _MOST_LEAKS)]
    for i, ((title, one), colour) in enumerate(zip(chosen, colours(len(chosen)), strict=True)):
        x = one[along].to_numpy() / quantity(one[along], one.attrs).scale
        drawn = {name: one[name].to_numpy() for name in one.data_vars if str(name).startswith("leak_rate")}
        axes.fill_between(x, drawn["leak_rate_low"], drawn["leak_rate_high"], color=colour, alpha=0.25, lw=0)
        axes.plot(x, drawn["leak_rate"], color=colour, linestyle=line_style(i), marker=".", label=title)
        if "leak_rate_one_way" in drawn:
            axes.plot(x, drawn["leak_rate_one_way"], color=colour, linestyle=":")
    abscissa = np.concatenate([one[along].to_numpy() for _, one in chosen])
    rates = np.concatenate([one["leak_rate"].to_numpy() for _, one in chosen])
    for axis, drawn_over in (("x", abscissa), ("y", rates)):
        positive = drawn_over[np.isfinite(drawn_over) & (drawn_over > 0)]
        if positive.size and positive.max() > _DECADE * positive.min():
            axes.set(**{f"{axis}scale": "log"})
    if axes.get_yscale() == "linear":
        axes.set_ylim(bottom=0.0)
    if len(curves) > 1:
        axes.legend(loc="lower center", bbox_to_anchor=(0.5, 1.0), ncols=2, fontsize="small")
    return [f"{len(chosen)} of {len(curves)} curves"] * (len(chosen) < len(curves))


# Stresses below the surface: sections with contours, and maps of the stresses at the interfaces.

MOST_SECTIONS = 3
MOST_INTERFACES = 2
LEVELS = 13


def inside_figure(
    case: Dataset,
    name: str = "",
    title: str = "",
    style: Style = PAPER,
    notes: Sequence[str] = (),
    *,
    every: bool = False,
) -> Figure:
    """Draw a stress below the surface at the snapshots, and of a surface the stresses at the interfaces.

    The field is von_mises (the default), largest_shear, shear_on_plane, or one of the file. A surface is cut
    along x, through its largest pressure at the last snapshot.
    """
    name = name or "von_mises"
    case = _with_fields(case)
    known = [each for each in dict.fromkeys([*BELOW, *INVARIANTS]) if each in case or each in INVARIANTS]
    known = [each for each in known if BELOW.get(each, "z") == "z"]
    if name not in known:
        allowed = f"must be one of {', '.join(known)}{nearest(name, known)}"
        raise ResultsError(f"below the surface there is no field {name}; {allowed}")
    is_line = "y" not in case["pressure"].dims
    with styled(style):
        part, left_out = part_of(case, case.sizes["snapshot"] if every else MOST_SECTIONS)
        seen = Extremes.of([case])
        cuts = section(part)
        drawn = _field(cuts, name)
        faces = _interfaces(case)
        shown = [] if is_line else faces[:MOST_INTERFACES]
        if len(shown) < len(faces) and not is_line:
            left_out.append(f"{len(shown)} of {len(faces)} interfaces")
        (left, right), depth = seen.view["x"], float(case["z"][-1]) - min(float(case["z"][0]), 0.0)
        high = 150.0 * min(max(depth / (right - left), 0.15), 0.45)
        low, top = seen.view.get("y", (0.0, 0.0))
        wide = 62.0 * min((top - low) / (right - left), 1.3) + 12.0
        figure = new_figure(2, 14.0 + (high + 9.0) * len(drawn) + wide * len(shown), style)
        heights = [high] * len(drawn) + [wide] * len(shown)
        grid = figure.add_gridspec(len(heights), 2, height_ratios=heights)
        panels = [figure.add_subplot(grid[0, :])]
        panels += [figure.add_subplot(grid[i, :], sharex=panels[0]) for i in range(1, len(drawn))]
        ends = _ends(drawn)
        for i, (axes, time) in enumerate(zip(panels, snapshot_titles(cuts), strict=True)):
            mesh = _draw_section(axes, cuts.isel(snapshot=i), drawn.isel(snapshot=i), seen, ends)
            axes.set_title(time, loc="right")
            labels = min(8, int(high / 7.0))  # of 7 mm, in which they do not overlap
            place = axes.inset_axes((1.02, 0.0, 0.02, 1.0))
            levels = mesh.levels[:: -(-len(mesh.levels) // labels)]
            bar = figure.colorbar(mesh, cax=place, ticks=levels, spacing="proportional")
            name_axes(bar.ax, y=quantity(drawn, case.attrs))
        name_axes(panels[-1], quantity(case["x"], case.attrs))
        panels[0].set_title(title, loc="left")
        last = part.isel(snapshot=-1)
        for row, face in enumerate(shown, start=len(drawn)):
            _draw_interface(figure, grid, row, last, face, seen)
        if "gap" in case:
            legend_above(figure, [contact_entry()])
        finish(figure, [*explained(case.assign({name: drawn}), [name], [title]), *notes, *left_out])
    return figure


def _with_fields(case: Dataset) -> Dataset:
    """Return the snapshots that have fields below the surface."""
    if "stress_zz" not in case or "z" not in case["stress_zz"].dims:
        allowed = "set output.inside and run the configuration again"
        raise ResultsError(f"the snapshots have no fields below the surface; {allowed}")
    first = case["stress_zz"].isel({name: 0 for name in case["stress_zz"].dims if name != "snapshot"})
    known = np.flatnonzero(first.notnull().to_numpy())
    if not known.size:
        raise ResultsError("no snapshot has fields below the surface; the run ended before them")
    return case.isel(snapshot=known)


def _field(case: Dataset, name: str) -> DataArray:
    """Return a field of the file, or one that follows from the stresses."""
    if name in case:
        return case[name].load()
    stress = {
        each[-2:]: case[each].to_numpy().astype(float)
        for each in BELOW
        if each in case and each[:7] == "stress_"
    }
    field = case["stress_zz"].copy(data=invariants(stress)[name]).rename(name)
    field.attrs["long_name"] = INVARIANTS[name]
    return field


def _interfaces(case: Dataset) -> list[int]:
    """Return the numbers of the rows above each interface."""
    layers = case["layer"].to_numpy()
    z = case["z"].to_numpy()
    return [i for i in range(len(z) - 1) if layers[i + 1] > layers[i] and z[i + 1] == z[i]]


def _ends(field: DataArray) -> tuple[float, float]:
    """Return the ends of the colours: from zero, or alike on both sides of zero."""
    low, high = float(field.min()), float(field.max())
    if low >= 0:
        return 0.0, high or 1.0
    return -max(-low, high), max(-low, high)


def _draw_section(
    axes: Axes, case: Dataset, field: DataArray, seen: Extremes, ends: tuple[float, float]
) -> Any:
    """Draw contours over x and z, layer by layer, the interfaces, and the contact at the surface."""
    left, right = seen.view["x"]
    x, z, s = (quantity(each, case.attrs) for each in (case["x"], case["z"], field))
    step = float(case["x"][1] - case["x"][0])
    part = field.sel(x=slice(left - step, right + step)).transpose("z", "x")
    along, depths = part["x"].to_numpy() / x.scale, part["z"].to_numpy() / z.scale
    values, layers = part.to_numpy() / s.scale, case["layer"].to_numpy()
    levels = MaxNLocator(LEVELS, symmetric=ends[0] < 0).tick_values(*np.divide(ends, s.scale))
    colours = SIGNED if ends[0] < 0 else "viridis"
    mesh = None
    for layer in np.unique(layers):
        rows = np.flatnonzero(layers == layer)
        if rows.size > 1:
            mesh = axes.contourf(along, depths[rows], values[rows], levels=levels, cmap=colours)
            axes.contour(along, depths[rows], values[rows], levels=levels, colors="0.25", linewidths=0.3)
    if mesh is None:
        raise ResultsError("no layer has two depths; give more in output.inside")
    for row in _interfaces(case):
        axes.axhline(depths[row], color="black", linewidth=1.0)
    touched = (
        touching(case).sel(x=part["x"]).to_numpy() if "gap" in case else np.zeros(along.size, dtype=bool)
    )
    top = np.where(touched, max(depths[0], 0.0), np.nan)  # a counterbody is above
    axes.plot(along, top, color=CONTACT, linewidth=3.0, clip_on=False, solid_capstyle="butt")
    axes.set(xlim=(left / x.scale, right / x.scale), ylim=(depths[-1], depths[0]))
    name_axes(axes, y=z)
    return mesh


def _draw_interface(figure: Figure, grid: Any, row: int, case: Dataset, face: int, seen: Extremes) -> None:
    """Draw maps of peel and shear stress at an interface."""
    at = case.isel(z=face)
    shear = at["stress_xz"].copy(data=np.hypot(at["stress_xz"], at["stress_yz"])).rename("shear_on_plane")
    shear.attrs["long_name"] = INVARIANTS["shear_on_plane"]
    x, y, z = (quantity(case[name], case.attrs) for name in "xyz")
    for column, field in enumerate((at["stress_zz"].load(), shear)):
        axes = figure.add_subplot(grid[row, column])
        ends = _ends(field)
        mesh = draw_map(axes, case, field, seen.view, ends, SIGNED if ends[0] < 0 else "viridis")
        axes.set_title(z.equals([float(f"{float(case['z'][face]) / z.scale:.4g}")])[0], loc="right")
        name_axes(axes, x, y if column == 0 else None)
        draw_bar(axes, mesh, quantity(field, case.attrs))
