"""Stresses below the surface: sections with contours, and maps of the stresses at the interfaces."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np
from matplotlib.ticker import MaxNLocator

from gfmdlayer.figures.labels import explained, finish, name_axes, quantity
from gfmdlayer.figures.plot_style import CONTACT, PAPER, Style, legend_above, new_figure, styled
from gfmdlayer.figures.snapshot_plots import (
    Extremes,
    contact_entry,
    draw_bar,
    draw_map,
    part_of,
    section,
    snapshot_titles,
    touching,
)
from gfmdlayer.history.inside import INVARIANTS, invariants
from gfmdlayer.results.schema import BELOW, ResultsError
from gfmdlayer.validation.problems import nearest

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure
    from xarray import DataArray, Dataset

MOST_SECTIONS = 3
MOST_INTERFACES = 2
LEVELS = 13
SIGNED = "RdBu_r"


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
        (left, right), depth = seen.view["x"], float(case["z"][-1])
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
            place, levels = axes.inset_axes((1.02, 0.0, 0.02, 1.0)), mesh.levels[:: -(-len(mesh.levels) // 8)]
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
    found = case["stress_zz"].copy(data=invariants(stress)[name]).rename(name)
    found.attrs["long_name"] = INVARIANTS[name]
    return found


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
    top = np.where(touched, depths[0], np.nan)
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
